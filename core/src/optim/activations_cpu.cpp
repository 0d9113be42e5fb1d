// SPDX-License-Identifier: Apache-2.0
#include "splatboost/activations.h"

#include "optim/activation_math.h"
#include "optim/cuda_ops.h"
#include "splatboost/elementwise.h"
#include "splatboost/errors.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "optim/activations_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "device/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

/// Applies function to whole vectors; the last one is padded with zeros.
template <class Function>
HWY_INLINE void map(const float* HWY_RESTRICT from, float* HWY_RESTRICT to, std::size_t n, const Function& function) {
  std::size_t i = 0;
  for (; i + lanes() <= n; i += lanes()) store(function(load(from + i)), to + i);
  if (i == n) return;
  alignas(64) float rest[kTileSize] = {};
  std::memcpy(rest, from + i, (n - i) * sizeof(float));
  store(function(load(rest)), rest);
  std::memcpy(to + i, rest, (n - i) * sizeof(float));
}

void exponentials_range(const float* from, float* to, std::size_t n) {
  map(from, to, n, [](Float x) HWY_ATTR { return exp_of(x); });
}

void sigmoids_range(const float* from, float* to, std::size_t n) {
  map(from, to, n, [](Float x) HWY_ATTR { return Float(1.0f) / (Float(1.0f) + exp_of(-x)); });
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost {
namespace {
HWY_EXPORT(exponentials_range);
HWY_EXPORT(sigmoids_range);
constexpr std::size_t kGrain = 1 << 13;
}  // namespace

void exponentials(std::span<const float> from, std::span<float> to, Device device) {
  SPLATBOOST_CHECK(from.size() == to.size(), "from and to must have the same size");
  if (device.is_cuda()) return cuda::exponentials(from, to, device.stream());
  device.threads().for_range(from.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    HWY_DYNAMIC_DISPATCH(exponentials_range)(from.data() + begin, to.data() + begin, end - begin);
  });
}

void sigmoids(std::span<const float> from, std::span<float> to, Device device) {
  SPLATBOOST_CHECK(from.size() == to.size(), "from and to must have the same size");
  if (device.is_cuda()) return cuda::sigmoids(from, to, device.stream());
  device.threads().for_range(from.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    HWY_DYNAMIC_DISPATCH(sigmoids_range)(from.data() + begin, to.data() + begin, end - begin);
  });
}

void exponential_gradients(std::span<const float> exponentials, std::span<float> gradients, Device device) {
  multiply(gradients, exponentials, gradients, device);  // the function is its own derivative
}

void sigmoid_gradients(std::span<const float> sigmoids, std::span<float> gradients, Device device) {
  SPLATBOOST_CHECK(sigmoids.size() == gradients.size(), "sigmoids and gradients must have the same size");
  if (device.is_cuda()) return cuda::sigmoid_gradients(sigmoids, gradients, device.stream());
  device.threads().for_range(gradients.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) gradients[i] *= sigmoid_slope(sigmoids[i]);
  });
}

}  // namespace splatboost
#endif  // HWY_ONCE
