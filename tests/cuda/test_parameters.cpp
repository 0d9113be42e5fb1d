// SPDX-License-Identifier: Apache-2.0
// What happens to parameters on a CUDA device: activations, Adam, rows that come and go; against the CPU.
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

TEST_F(CudaParameters, RowsComeAndGoAsOnTheCpu) {
  for (const std::size_t width : {1u, 3u, 45u}) {
    const std::size_t rows = 301;
    std::vector<float> tensor = numbers(rows * width, -1, 1, width);
    DeviceArray<float> on_device(stream(), tensor);

    std::vector<std::uint8_t> removed(rows);
    for (std::size_t i = 0; i < rows; ++i) removed[i] = i % 3 == 0 || i > 290 ? 9 : 0;
    remove_rows(tensor, width, removed);
    remove_rows(on_device, width, DeviceArray<std::uint8_t>(stream(), removed).span());
    ASSERT_EQ(on_device.to_host(), tensor);

    const std::vector<std::uint32_t> copied = {5, 0, 5, 100};
    append_rows(tensor, width, copied);
    append_rows(on_device, width, DeviceArray<std::uint32_t>(stream(), copied).span());
    ASSERT_EQ(on_device.to_host(), tensor);

    std::vector<std::uint32_t> order(tensor.size() / width);
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<std::uint32_t>(i * 7 % order.size());
    reorder_rows(tensor, width, order);
    reorder_rows(on_device, width, DeviceArray<std::uint32_t>(stream(), order).span());
    ASSERT_EQ(on_device.to_host(), tensor);

    append_zero_rows(tensor, width, 6);
    append_zero_rows(on_device, width, 6);
    ASSERT_EQ(on_device.to_host(), tensor);
  }
}

TEST_F(CudaParameters, AllRowsOrNoneMayGo) {
  DeviceArray<float> tensor(stream(), std::vector<float>{1, 2, 3, 4});
  remove_rows(tensor, 2, DeviceArray<std::uint8_t>(stream(), std::vector<std::uint8_t>{0, 0}).span());
  EXPECT_EQ(tensor.to_host(), (std::vector<float>{1, 2, 3, 4}));
  remove_rows(tensor, 2, DeviceArray<std::uint8_t>(stream(), std::vector<std::uint8_t>{1, 1}).span());
  EXPECT_TRUE(tensor.empty());
  append_rows(tensor, 2, {});
  append_zero_rows(tensor, 2, 1);
  EXPECT_EQ(tensor.to_host(), (std::vector<float>{0, 0}));
}

}  // namespace
}  // namespace splatboost::test
