// SPDX-License-Identifier: Apache-2.0
// Memory of a CUDA device, and what the host may read of it without waiting.
#include <gtest/gtest.h>

#include <limits>
#include <numeric>
#include <vector>

#include "cuda/cuda_device.h"
#include "splatboost/array.h"
#include "splatboost/cuda_laps.h"
#include "splatboost/device.h"
#include "splatboost/device_array.h"
#include "splatboost/threads.h"

namespace splatboost::test {
namespace {

using DeviceMemory = OnCuda<>;

std::vector<float> counting(std::size_t n) {
  std::vector<float> values(n);
  std::iota(values.begin(), values.end(), 1.0f);
  return values;
}

TEST_F(DeviceMemory, ComesBackAsItWent) {
  const std::vector<float> values = counting(1000);
  const DeviceArray<float> array(stream(), values);
  EXPECT_EQ(array.to_host(), values);
}

TEST_F(DeviceMemory, ResizeKeepsValuesAndGrowsGeometrically) {
  DeviceArray<float> array(stream(), counting(10));
  array.resize(1000);
  EXPECT_EQ(copy_to_host(std::as_const(array).span().first(10), stream()), counting(10));
  const std::uint64_t before = stream().activity().allocations;
  for (std::size_t n = 1000; n < 100000; n += 1 + n / 100) {
    array.resize(n);
    array.fill_zero();  // initializes what the next growth copies
  }
  EXPECT_LE(stream().activity().allocations - before, 12u);  // log 100 / log 1.5
}

TEST_F(DeviceMemory, SmallerSizesAllocateNothing) {
  DeviceArray<float> array(stream());
  array.ensure(1000);
  const std::uint64_t before = stream().activity().allocations;
  for (const std::size_t n : {10u, 1000u, 0u, 500u}) {
    array.ensure(n);
    EXPECT_EQ(array.size(), n);
    array.resize(n / 2);
  }
  EXPECT_EQ(stream().activity().allocations, before);
}

TEST_F(DeviceMemory, FillsWithZero) {
  DeviceArray<float> array(stream(), counting(33));
  array.fill_zero();
  EXPECT_EQ(array.to_host(), std::vector<float>(33, 0.0f));
}

TEST_F(DeviceMemory, OnlyReadingWaits) {
  const std::uint64_t before = stream().activity().synchronizations;
  DeviceArray<float> array(stream(), counting(33));
  array.resize(2000);
  array.fill_zero();
  EXPECT_EQ(stream().activity().synchronizations, before);
  static_cast<void>(array.to_host());
  EXPECT_EQ(stream().activity().synchronizations, before + 1);
}

TEST_F(DeviceMemory, TooMuchNamesTheBytesWantedAndHad) {
  DeviceArray<float> array(stream(), counting(33));
  const std::size_t far_too_many = std::size_t{1} << 45;
  DeviceArray<float> hopeless(stream());
  try {
    hopeless.ensure(far_too_many);
    FAIL() << "nothing was thrown";
  } catch (const DeviceMemoryError& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find(std::to_string(4 * far_too_many) + " bytes requested"), std::string::npos) << text;
    EXPECT_NE(text.find("free"), std::string::npos) << text;
  }
  EXPECT_EQ(array.to_host(), counting(33));  // the stream is still usable
}

TEST_F(DeviceMemory, ADeviceIsThreadsOrAStream) {
  Threads threads(1);
  const Device cpu(threads), cuda(stream());
  EXPECT_FALSE(cpu.is_cuda());
  EXPECT_TRUE(cuda.is_cuda());
  EXPECT_EQ(&cuda.stream(), &stream());
  EXPECT_THROW(cuda.threads(), ArgumentError);
  EXPECT_THROW(cpu.stream(), ArgumentError);
}

TEST_F(DeviceMemory, LapsAreTakenInOrderAndWithoutAWait) {
  CudaLaps laps(stream());
  DeviceArray<float> array(stream());
  array.ensure(1 << 10);
  std::uint64_t waits = stream().activity().synchronizations;
  for (int i = 0; i < 3000; ++i) {  // more marks than are kept
    if (i % 300 == 0) {             // … but never more at a time, however slow the device is
      stream().synchronize();
      ++waits;
    }
    laps.mark(nullptr);
    array.fill_zero();
    laps.mark("first");
    laps.mark("second");
    while (i % 10 == 0 && laps.take()) continue;
  }
  EXPECT_EQ(stream().activity().synchronizations, waits);
  stream().synchronize();
  while (laps.take()) continue;
  for (int i = 0; i < 9; ++i) {
    laps.mark(nullptr);
    laps.mark("first");
    laps.mark("second");
  }
  stream().synchronize();
  for (int i = 0; i < 9; ++i) {
    const std::optional<CudaLaps::Lap> first = laps.take();
    ASSERT_TRUE(first);
    EXPECT_STREQ(first->stage, "first");
    EXPECT_GE(first->seconds, 0);
    const std::optional<CudaLaps::Lap> second = laps.take();
    ASSERT_TRUE(second);
    EXPECT_STREQ(second->stage, "second");
  }
  EXPECT_FALSE(laps.take());
  // If laps are not taken, the oldest are dropped.
  for (int i = 0; i < 5000; ++i) laps.mark("more");
  stream().synchronize();
  EXPECT_TRUE(laps.take());
}

TEST_F(DeviceMemory, WaitingForAnEventForgetsOnlyTheKernelsBeforeIt) {
  CudaLaps laps(stream());
  stream().begin_launch("early_kernel");
  for (int i = 0; i < 1100; ++i) laps.mark("lap");
  stream().begin_launch("late_kernel");
  const std::uint64_t before = stream().activity().synchronizations;
  laps.mark("lap");  // waits for the oldest mark
  ASSERT_EQ(stream().activity().synchronizations, before + 1);
  try {
    stream().check(1, "a test");
    FAIL() << "nothing was thrown";
  } catch (const DeviceError& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find("late_kernel"), std::string::npos) << text;
    EXPECT_EQ(text.find("early_kernel"), std::string::npos) << text;
  }
  stream().synchronize();
  try {
    stream().check(1, "a test");
    FAIL() << "nothing was thrown";
  } catch (const DeviceError& error) {
    EXPECT_EQ(std::string(error.what()).find("kernel"), std::string::npos) << error.what();
  }
}

TEST_F(DeviceMemory, GoesAlongWithStreamsOfACaller) {
  CudaStream along(0, nullptr);
  DeviceArray<float> array(along);
  {
    const CudaCall call(along, stream().handle());
    EXPECT_EQ(along.handle(), stream().handle());
    array.upload(counting(100));
  }
  for (int k = 0; k < 3; ++k) {
    CudaStream other;  // destroyed before the next call
    const CudaCall call(along, other.handle());
    array.resize(array.size() + 1);
  }
  const CudaCall call(along, nullptr);
  EXPECT_EQ(copy_to_host(std::as_const(array).span().first(100), along), counting(100));
  EXPECT_EQ(along.activity().synchronizations, 1u);  // only that of the copy to the host
}

TEST(CudaDevices, ACallOnOneThatIsNotThereIsNamed) {
  CudaStream along(99, nullptr);
  EXPECT_THROW(CudaCall(along, nullptr), NoDeviceError);
}

TEST(CudaDevices, OneThatIsNotThereIsNamed) {
  try {
    CudaStream stream(99);
    FAIL() << "nothing was thrown";
  } catch (const NoDeviceError& error) {
    EXPECT_NE(std::string(error.what()).find("CUDA device 99"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace splatboost::test
