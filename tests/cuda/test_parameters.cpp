// SPDX-License-Identifier: Apache-2.0
// Parameters on a CUDA device: activations, Adam, rows that are added and removed; against the CPU.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "cuda/cuda_device.h"
#include "splatboost/activations.h"
#include "splatboost/adam.h"
#include "splatboost/device_array.h"
#include "splatboost/rows.h"
#include "splatboost/threads.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

using CudaParameters = OnCuda<>;

TEST_F(CudaParameters, ActivationsAreExponentialAndSigmoid) {
  std::vector<float> values = numbers(1000, -20, 20, 1);
  values.insert(values.end(), {0.0f, 87.9f, 100.0f, -100.0f, 1e30f, -1e30f});
  const DeviceArray<float> from(stream(), values);
  DeviceArray<float> to(stream());
  to.ensure(values.size());
  exponentials(from.span(), to.span(), stream());
  std::vector<float> found = to.to_host();
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double exact = std::exp(std::min(static_cast<double>(values[i]), 88.0));
    ASSERT_NEAR(found[i], exact, 3e-7 * exact + 1e-37) << values[i];
  }
  sigmoids(from.span(), to.span(), stream());
  found = to.to_host();
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double exact = 1 / (1 + std::exp(-static_cast<double>(values[i])));
    ASSERT_NEAR(found[i], exact, 1e-6 * exact + 1e-37) << values[i];
  }
}

TEST_F(CudaParameters, AdamIsThatOfTheCpu) {
  Threads threads(1);
  const std::size_t n = 700;
  std::vector<float> values = numbers(n, -1, 1, 2), first(n, 0.0f), second(n, 0.0f);
  DeviceArray<float> on_device(stream(), values), device_first(stream(), first), device_second(stream(), second);
  const AdamOptions options{0.01f, 0.9f, 0.999f, 1e-15f};
  for (std::int64_t step = 1; step <= 5; ++step) {
    std::vector<float> gradients = numbers(n, -0.5, 0.5, static_cast<std::uint64_t>(step + 10));
    DeviceArray<float> device_gradients(stream(), gradients);
    adam_step(values, gradients, first, second, step, options, threads);
    adam_step(on_device.span(), device_gradients.span(), device_first.span(), device_second.span(), step, options,
              stream());
    EXPECT_EQ(device_gradients.to_host(), std::vector<float>(n, 0.0f));
  }
  const std::vector<float> found = on_device.to_host(), moments = device_second.to_host();
  for (std::size_t i = 0; i < n; ++i) {
    ASSERT_NEAR(found[i], values[i], 2e-6);
    ASSERT_NEAR(moments[i], second[i], 1e-6f * second[i]);
  }
}

}  // namespace
}  // namespace splatboost::test
