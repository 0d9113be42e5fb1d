// SPDX-License-Identifier: Apache-2.0
#include "splatboost/elementwise.h"

#include <algorithm>

#include "optim/cuda_ops.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

constexpr std::size_t kGrain = 1 << 13;

template <class Body>
void for_each(std::size_t n, const Threads& threads, const Body& body) {
  threads.for_range(n, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) body(i);
  });
}

}  // namespace

void scale(std::span<float> values, float factor, Device device) {
  if (device.is_cuda()) return cuda::scale(values, factor, device.stream());
  for_each(values.size(), device.threads(), [&](std::size_t i) { values[i] *= factor; });
}

void multiply(std::span<const float> values, std::span<const float> factors, std::span<float> products, Device device) {
  const std::size_t n = values.size();
  SPLATBOOST_CHECK(factors.size() == n && products.size() == n, "values, factors and products must have the same size");
  if (device.is_cuda()) return cuda::multiply(values, factors, products, device.stream());
  for_each(n, device.threads(), [&](std::size_t i) { products[i] = values[i] * factors[i]; });
}

void add_products(std::span<const float> values, std::span<const float> factors, std::span<float> sums, Device device) {
  const std::size_t n = values.size();
  SPLATBOOST_CHECK(factors.size() == n && sums.size() == n, "values, factors and sums must have the same size");
  if (device.is_cuda()) return cuda::add_products(values, factors, sums, device.stream());
  for_each(n, device.threads(), [&](std::size_t i) { sums[i] += values[i] * factors[i]; });
}

void average_in(std::span<const float> values, float share, std::span<float> averages, Device device) {
  const std::size_t n = values.size();
  SPLATBOOST_CHECK(averages.size() == n, "values and averages must have the same size");
  if (device.is_cuda()) return cuda::average_in(values, share, averages, device.stream());
  for_each(n, device.threads(), [&](std::size_t i) { averages[i] += share * (values[i] - averages[i]); });
}

void clamp_above(std::span<float> values, float bound, Device device) {
  if (device.is_cuda()) return cuda::clamp_above(values, bound, device.stream());
  for_each(values.size(), device.threads(), [&](std::size_t i) { values[i] = std::min(values[i], bound); });
}

void clear_from(std::span<const float> values, float bound, std::span<float> gradients, Device device) {
  SPLATBOOST_CHECK(gradients.size() == values.size(), "values and gradients must have the same size");
  if (device.is_cuda()) return cuda::clear_from(values, bound, gradients, device.stream());
  for_each(values.size(), device.threads(), [&](std::size_t i) {
    if (values[i] >= bound) gradients[i] = 0;
  });
}

}  // namespace splatboost
