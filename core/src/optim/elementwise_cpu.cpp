// SPDX-License-Identifier: Apache-2.0
#include "splatboost/elementwise.h"

#include "optim/cuda_ops.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

constexpr std::size_t kGrain = 1 << 13;

template <class Body>
void for_each(std::size_t n, Threads& threads, const Body& body) {
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
  SPLATBOOST_CHECK(factors.size() == n && products.size() == n, "values, factors and products must be of one size");
  if (device.is_cuda()) return cuda::multiply(values, factors, products, device.stream());
  for_each(n, device.threads(), [&](std::size_t i) { products[i] = values[i] * factors[i]; });
}

void add_products(std::span<const float> values, std::span<const float> factors, std::span<float> sums, Device device) {
  const std::size_t n = values.size();
  SPLATBOOST_CHECK(factors.size() == n && sums.size() == n, "values, factors and sums must be of one size");
  if (device.is_cuda()) return cuda::add_products(values, factors, sums, device.stream());
  for_each(n, device.threads(), [&](std::size_t i) { sums[i] += values[i] * factors[i]; });
}

}  // namespace splatboost
