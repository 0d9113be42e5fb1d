// SPDX-License-Identifier: Apache-2.0
#include "splatboost/adam.h"

#include <cmath>

#include "optim/adam_math.h"
#include "optim/cuda_ops.h"
#include "splatboost/errors.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "optim/adam_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

void adam_range(float* HWY_RESTRICT values, float* HWY_RESTRICT gradients, float* HWY_RESTRICT first,
                float* HWY_RESTRICT second, std::size_t n, const AdamFactors& f) {
  for (std::size_t i = 0; i < n; ++i) {
    adam_one(f, gradients[i], values[i], first[i], second[i]);
    gradients[i] = 0.0f;
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost {
namespace {
HWY_EXPORT(adam_range);
constexpr std::size_t kGrain = 1 << 14;
}  // namespace

void adam_step(std::span<float> values, std::span<float> gradients, std::span<float> first_moments,
               std::span<float> second_moments, std::int64_t step, const AdamOptions& options, Device device) {
  const std::size_t n = values.size();
  SPLATBOOST_CHECK(gradients.size() == n && first_moments.size() == n && second_moments.size() == n,
                   "values, gradients and moments must have the same size");
  SPLATBOOST_CHECK(step >= 1, "steps count from 1");
  if (device.is_cuda()) {
    return cuda::adam_step(values, gradients, first_moments, second_moments, step, options, device.stream());
  }
  const AdamFactors factors = adam_factors(options, step);
  device.threads().for_range(n, kGrain, [&](std::size_t begin, std::size_t end) {
    HWY_DYNAMIC_DISPATCH(adam_range)
    (values.data() + begin, gradients.data() + begin, first_moments.data() + begin, second_moments.data() + begin,
     end - begin, factors);
  });
}

}  // namespace splatboost
#endif  // HWY_ONCE
