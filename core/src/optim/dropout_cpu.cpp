// SPDX-License-Identifier: Apache-2.0
#include "splatboost/dropout.h"

#include "optim/cuda_ops.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {
constexpr std::size_t kGrain = 4096;
}

void dropout_factors(const RandomStream& random, double rate, std::span<float> factors, Device device) {
  SPLATBOOST_CHECK(rate >= 0 && rate < 1, "rate must lie in [0, 1)");
  const auto kept = static_cast<float>(1 / (1 - rate));
  if (device.is_cuda()) return cuda::dropout_factors(random, rate, kept, factors, device.stream());
  device.threads().for_range(factors.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) factors[i] = random.uniform(i) < rate ? 0.0f : kept;
  });
}

}  // namespace splatboost
