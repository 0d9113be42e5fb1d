// SPDX-License-Identifier: Apache-2.0
/// @file Gradients of the coefficients of higher SH bands, kept as factors. A view's gradient of the coefficients
/// [sh_rest_rows,3] of a Gaussian is the product of the basis at its view direction and the gradient of its colour: six
/// numbers instead of 45, which are most of what a backward pass writes. On the CPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "splatboost/adam.h"
#include "splatboost/threads.h"

namespace splatboost {

/// Numbers per Gaussian: unit view direction, gradient of the colour.
inline constexpr std::size_t kShFactors = 6;

/// Factors of one view, as GaussianGradients::sh_factors receives them.
struct ShFactors {
  std::span<const float> rows;  ///< [N,6]
  int degree = 0;               ///< SH degree that the view was rendered with
};

/// The sum of the gradients of the views. @param gradients [N,sh_rest_rows,3], overwritten
void sum_sh_gradients(std::span<const ShFactors> views, int sh_rest_rows, std::span<float> gradients,
                      const Threads& threads);

/// adam_step() with the sum of the gradients of the views, which is not stored.
/// @param values [N,sh_rest_rows,3] @param first_moments,second_moments of the same size @param step from 1
void adam_step_sh(std::span<float> values, int sh_rest_rows, std::span<const ShFactors> views,
                  std::span<float> first_moments, std::span<float> second_moments, std::int64_t step,
                  const AdamOptions& options, const Threads& threads);

}  // namespace splatboost
