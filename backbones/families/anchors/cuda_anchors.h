// SPDX-License-Identifier: Apache-2.0
/// @file CUDA implementations behind the public functions for anchors, defined in anchor_view_cuda.cu and
/// slot_statistics_cuda.cu; a build without CUDA or without the cuBLAS header has cuda_anchors_absent.cpp instead.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "families/anchors/anchor_view.h"
#include "splatboost/cuda_stream.h"

namespace splatboost::cuda {

std::unique_ptr<AnchorView::Work> make_anchor_view(const DecoderShape& shape, CudaStream& stream);

/// As in slot_statistics.h.
void add_anchor_opacities(std::span<const std::uint32_t> anchors, std::span<const float> opacities,
                          std::span<float> opacity_sums, std::span<float> seen, CudaStream& stream);
void add_slot_gradients(std::span<const std::uint32_t> slots, std::span<const std::uint8_t> drawn,
                        std::span<const float> gradients, float to_ndc_x, float to_ndc_y,
                        std::span<float> gradient_sums, std::span<float> seen, CudaStream& stream);
void add_slot_counts(std::span<const std::uint32_t> slots, std::span<const std::int32_t> view_counts,
                     std::span<std::int32_t> counts, CudaStream& stream);

}  // namespace splatboost::cuda
