// SPDX-License-Identifier: Apache-2.0
/// @file Arithmetic on arrays, element by element.
#pragma once

#include <span>

#include "splatboost/device.h"

namespace splatboost {

/// values[i] *= factor
void scale(std::span<float> values, float factor, Device device);

/// products[i] = values[i] · factors[i]. `products` may be the memory of an input.
void multiply(std::span<const float> values, std::span<const float> factors, std::span<float> products, Device device);

/// sums[i] += values[i] · factors[i]
void add_products(std::span<const float> values, std::span<const float> factors, std::span<float> sums, Device device);

/// averages[i] += share · (values[i] − averages[i])
void average_in(std::span<const float> values, float share, std::span<float> averages, Device device);

/// values[i] = min(values[i], bound)
void clamp_above(std::span<float> values, float bound, Device device);

/// gradients[i] = 0 where values[i] >= bound: the backward pass of clamp_above().
/// @param values as clamp_above() left them
void clear_from(std::span<const float> values, float bound, std::span<float> gradients, Device device);

}  // namespace splatboost
