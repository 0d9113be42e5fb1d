// SPDX-License-Identifier: Apache-2.0
/// @file CUDA implementations of this folder's operations, called by the public functions, which check the arguments.
/// Each is defined in the .cu file of its name; a build without CUDA compiles cuda_absent.cpp instead.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "splatboost/convex_training.h"
#include "splatboost/cuda_stream.h"
#include "splatboost/density_statistics.h"
#include "splatboost/random.h"

namespace splatboost::cuda {

/// As in density_statistics.h.
void add_screen_gradients(const ScreenGradients& view, AbsoluteNorm norm, float views, const ScreenGradientSums& sums,
                          CudaStream& stream);
void add_screen_radii(std::span<const std::int32_t> radii, std::span<const std::int32_t> observed,
                      std::span<std::int32_t> largest, CudaStream& stream);
void mean_screen_gradients(const ScreenGradientSums& sums, std::span<float> means, std::span<float> means_abs,
                           CudaStream& stream);
void longest_scales(std::span<const float> scales, std::span<float> longest, CudaStream& stream);

/// As in clearance.h.
void camera_clearances(std::span<const float> means, std::span<const float> centres, std::span<const float> distances,
                       std::span<float> clearances, CudaStream& stream);

/// As ScoreSums::add_view().
void add_view(std::span<const std::int32_t> view_counts, double photometric_loss, std::span<std::int64_t> counts,
              std::span<double> weighted_counts, CudaStream& stream);

/// As in scores.h.
void importance_scores(std::span<const std::int64_t> counts, int views, std::span<std::int64_t> scores,
                       CudaStream& stream);
void pruning_scores(std::span<const double> weighted_counts, std::span<float> scores, CudaStream& stream);

/// As in select.h.
std::size_t keep_important(std::span<const std::int64_t> importance, double threshold,
                           std::span<std::uint8_t> candidates, CudaStream& stream);
void keep_weighted_sample(std::span<const float> weights, std::size_t keep, const RandomStream& random,
                          std::span<std::uint8_t> candidates, CudaStream& stream);
void keep_largest(std::span<const float> priorities, std::size_t keep, std::span<std::uint8_t> candidates,
                  CudaStream& stream);
std::size_t spare_one(std::span<const float> priorities, std::span<std::uint8_t> removals, CudaStream& stream);

/// As in convex_training.h.
void mask_opacities(std::span<const float> opacities, std::span<const float> masks, std::span<float> drawn,
                    CudaStream& stream);
void mask_opacities_backward(std::span<const float> opacities, std::span<const float> masks,
                             std::span<const float> drawn, float mask_slope, std::span<float> opacity_gradients,
                             std::span<float> mask_gradients, CudaStream& stream);
void add_sharpness_gradients(std::span<const std::uint8_t> visible, std::span<const float> gradients,
                             std::span<const float> gradients_abs, const SharpnessSums& sums, CudaStream& stream);

}  // namespace splatboost::cuda
