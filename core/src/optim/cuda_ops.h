// SPDX-License-Identifier: Apache-2.0
/// @file CUDA implementations of this folder's operations, called by the public functions, which check the arguments.
/// Each is defined in the .cu file of its name; a build without CUDA compiles cuda_absent.cpp instead.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "splatboost/adam.h"
#include "splatboost/cuda_stream.h"
#include "splatboost/device_array.h"
#include "splatboost/random.h"

namespace splatboost::cuda {

void exponentials(std::span<const float> from, std::span<float> to, CudaStream& stream);
void sigmoids(std::span<const float> from, std::span<float> to, CudaStream& stream);
void sigmoid_gradients(std::span<const float> sigmoids, std::span<float> gradients, CudaStream& stream);

/// As in elementwise.h.
void scale(std::span<float> values, float factor, CudaStream& stream);
void multiply(std::span<const float> values, std::span<const float> factors, std::span<float> products,
              CudaStream& stream);
void add_products(std::span<const float> values, std::span<const float> factors, std::span<float> sums,
                  CudaStream& stream);
void average_in(std::span<const float> values, float share, std::span<float> averages, CudaStream& stream);
void clamp_above(std::span<float> values, float bound, CudaStream& stream);
void clear_from(std::span<const float> values, float bound, std::span<float> gradients, CudaStream& stream);

/// @param kept factor of elements that are not dropped
void dropout_factors(const RandomStream& random, double rate, float kept, std::span<float> factors, CudaStream& stream);

void adam_step(std::span<float> values, std::span<float> gradients, std::span<float> first_moments,
               std::span<float> second_moments, std::int64_t step, const AdamOptions& options, CudaStream& stream);

/// Copies row rows[i] of `from` to row i of `to`.
void gather_rows(std::span<const float> from, std::size_t width, std::span<const std::uint32_t> rows,
                 std::span<float> to, CudaStream& stream);

}  // namespace splatboost::cuda
