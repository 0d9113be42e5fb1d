// SPDX-License-Identifier: Apache-2.0
// Tests of the emulator: correct kernels give correct results, and deliberate faults are found.
#include <gtest/gtest.h>

#include <cuda_runtime.h>
#include <cub/cub.cuh>

#include <cstdint>
#include <functional>
#include <limits>
#include <numeric>
#include <span>
#include <string>
#include <vector>

#include "../../../core/src/device/device_view.h"

namespace splatboost::test {
namespace {

template <class... Parameters, class... Arguments>
void start(void (*kernel)(Parameters...), unsigned blocks, unsigned threads, Arguments&&... arguments) {
  cudaLaunchConfig_t shape{};
  shape.gridDim = dim3(blocks);
  shape.blockDim = dim3(threads);
  ASSERT_EQ(cudaLaunchKernelEx(&shape, kernel, std::forward<Arguments>(arguments)...), cudaSuccess);
  ASSERT_EQ(cudaStreamSynchronize(nullptr), cudaSuccess);
}

/// Expects a fault whose message contains `part`, and that a kernel runs correctly after it.
void expect_fault(const std::function<void()>& launch, const std::string& part) {
  for (const std::uint64_t seed : {0u, 1u, 2u, 3u}) {
    cuda_on_cpu::permute(seed);
    try {
      launch();
      ADD_FAILURE() << "no fault was found, seed " << seed;
    } catch (const cuda_on_cpu::Fault& fault) {
      EXPECT_NE(std::string(fault.what()).find(part), std::string::npos) << fault.what();
    }
  }
  cuda_on_cpu::permute(1);
}

/// Runs a test in several orders of execution.
class Orders : public ::testing::TestWithParam<std::uint64_t> {
 protected:
  void SetUp() override { cuda_on_cpu::permute(GetParam()); }
  void TearDown() override { cuda_on_cpu::permute(1); }
};

// ---- correct kernels

__global__ void write_index(DeviceView<int> out) {
  const std::size_t i = blockIdx.x * blockDim.x + threadIdx.x;
  if (i < out.size()) out[i] = static_cast<int>(i);
}

TEST_P(Orders, EveryThreadRunsOnce) {
  std::vector<int> out(1000, -1), expected(1000);
  std::iota(expected.begin(), expected.end(), 0);
  start(write_index, 8, 128, std::span(out));
  EXPECT_EQ(out, expected);
}

/// @tparam kBarriers whether the barriers that it needs are there
template <bool kBarriers>
__global__ void reverse_blocks(DeviceView<int> values) {
  __shared__ SharedArray<int, 128> shared;
  const int t = static_cast<int>(threadIdx.x);
  const std::size_t at = blockIdx.x * blockDim.x;
  shared.set(t, values[at + threadIdx.x]);
  if (kBarriers) __syncthreads();
  values[at + threadIdx.x] = shared.get(127 - t);
}

TEST_P(Orders, SharedMemoryIsOfTheBlock) {
  std::vector<int> values(512);
  std::iota(values.begin(), values.end(), 0);
  start(reverse_blocks<true>, 4, 128, std::span(values));
  for (int i = 0; i < 512; ++i) EXPECT_EQ(values[static_cast<std::size_t>(i)], i / 128 * 128 + 127 - i % 128);
}

// Lane 7 reads lane 8, which is not in the mask: the value is undefined in CUDA.
__global__ void shuffle_beyond_mask(DeviceView<int> out) {
  const int lane = static_cast<int>(threadIdx.x) % 32;
  if (lane < 8) out[threadIdx.x] = __shfl_down_sync(0xffu, lane, 1);
}

__global__ void warp_functions(DeviceView<int> out) {
  const int lane = static_cast<int>(threadIdx.x) % 32;
  int sum = lane;
  for (int step = 16; step > 0; step /= 2) sum += __shfl_xor_sync(0xffffffffu, sum, step);
  const unsigned odd = __ballot_sync(0xffffffffu, lane % 2 == 1);
  int part = 0;
  if (lane < 8) part = __shfl_xor_sync(0xffu, lane, 1);
  __syncwarp();
  const bool any = __any_sync(0xffffffffu, lane == 7), all = __all_sync(0xffffffffu, lane < 31);
  const auto added = static_cast<int>(__reduce_add_sync(0xffffffffu, static_cast<unsigned>(lane)));
  const int third = __shfl_sync(0xffffffffu, lane + 100, 3);
  const int down = __shfl_down_sync(0xffffffffu, lane, 30);
  const bool right = sum == 496 && odd == 0xaaaaaaaau && (lane >= 8 || part == (lane ^ 1)) && any && !all &&
                     added == 496 && third == 103 && down == (lane < 2 ? lane + 30 : lane);
  out[threadIdx.x] = right ? 1 : 0;
}

TEST_P(Orders, WarpFunctions) {
  std::vector<int> out(96, 0);
  start(warp_functions, 1, 96, std::span(out));
  EXPECT_EQ(out, std::vector<int>(96, 1));
}

__global__ void count_in_shared(DeviceView<int> out) {
  __shared__ SharedArray<int, 4> bins;
  if (threadIdx.x < 4) bins.set(static_cast<int>(threadIdx.x), 0);
  __syncthreads();
  bins.add(static_cast<int>(threadIdx.x) % 4, 1);
  const int odd = __syncthreads_count(threadIdx.x % 2 == 1);
  if (threadIdx.x < 4) atomicAdd(&out[threadIdx.x], bins.get(static_cast<int>(threadIdx.x)) * odd);
}

TEST_P(Orders, AtomicsAndCountingBarriers) {
  std::vector<int> out(4, 0);
  start(count_in_shared, 3, 64, std::span(out));
  EXPECT_EQ(out, std::vector<int>(4, 3 * 16 * 32));
}

INSTANTIATE_TEST_SUITE_P(Seeds, Orders, ::testing::Values(0, 1, 2, 12345));

__global__ void order_of_arrival(DeviceView<int> next, DeviceView<int> out) {
  out[static_cast<std::size_t>(atomicAdd(&next[0], 1))] = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
}

TEST(Emulator, SeedsChangeTheOrder) {
  std::vector<std::vector<int>> found;
  for (const std::uint64_t seed : {0u, 1u, 2u, 1u}) {
    cuda_on_cpu::permute(seed);
    std::vector<int> next(1, 0), out(64, 0);
    start(order_of_arrival, 2, 32, std::span(next), std::span(out));
    found.push_back(out);
  }
  cuda_on_cpu::permute(1);
  EXPECT_TRUE(std::is_sorted(found[0].begin(), found[0].end()));
  EXPECT_NE(found[1], found[0]);
  EXPECT_NE(found[1], found[2]);
  EXPECT_EQ(found[1], found[3]);
}

// ---- deliberate faults

TEST(EmulatorFinds, AMissingBarrier) {
  std::vector<int> values(128);
  expect_fault([&] { start(reverse_blocks<false>, 1, 128, std::span(values)); }, "shared array");
}

/// Lacks the barrier between the reads of one round and the writes of the next.
__global__ void overwrites_too_early(DeviceView<int> out) {
  __shared__ SharedArray<int, 64> shared;
  const int t = static_cast<int>(threadIdx.x);
  for (int round = 0; round < 2; ++round) {
    shared.set(t, round);
    __syncthreads();
    out[threadIdx.x] = shared.get(63 - t);
  }
}

TEST(EmulatorFinds, AMissingBarrierBeforeTheNextRound) {
  std::vector<int> out(64);
  expect_fault([&] { start(overwrites_too_early, 1, 64, std::span(out)); }, "shared array");
}

template <bool kWarpSync>
__global__ void exchange_in_warp(DeviceView<int> out) {
  __shared__ SharedArray<int, 64> shared;
  const int t = static_cast<int>(threadIdx.x);
  shared.set(t, t);
  if (kWarpSync) __syncwarp();
  out[threadIdx.x] = shared.get(t ^ 1);
}

TEST(EmulatorFinds, AMissingSyncwarp) {
  std::vector<int> out(64);
  start(exchange_in_warp<true>, 1, 64, std::span(out));
  for (int i = 0; i < 64; ++i) EXPECT_EQ(out[static_cast<std::size_t>(i)], i ^ 1);
  expect_fault([&] { start(exchange_in_warp<false>, 1, 64, std::span(out)); }, "shared array");
}

__global__ void reads_what_nobody_wrote(DeviceView<int> out) {
  __shared__ SharedArray<int, 64> shared;
  if (threadIdx.x < 32) shared.set(static_cast<int>(threadIdx.x), 1);
  __syncthreads();
  out[threadIdx.x] = shared.get(static_cast<int>(threadIdx.x));
}

TEST(EmulatorFinds, SharedMemoryThatNobodyWrote) {
  std::vector<int> out(64);
  expect_fault([&] { start(reads_what_nobody_wrote, 1, 64, std::span(out)); }, "no thread of the block wrote");
}

__global__ void writes_beyond(DeviceView<int> out) { out[blockIdx.x * blockDim.x + threadIdx.x] = 1; }

TEST(EmulatorFinds, AnAccessOutOfBounds) {
  std::vector<int> out(100);
  expect_fault([&] { start(writes_beyond, 1, 128, std::span(out)); }, "of a view of 100 elements");
}

__global__ void writes_beyond_shared(int n) {
  __shared__ SharedArray<int, 64> shared;
  shared.set(static_cast<int>(threadIdx.x) + n, 1);
}

TEST(EmulatorFinds, AnAccessOutOfBoundsOfSharedMemory) {
  expect_fault([&] { start(writes_beyond_shared, 1, 64, 1); }, "of a shared array of 64 elements");
}

__global__ void masks_itself_out() {
  if (threadIdx.x < 16) static_cast<void>(__ballot_sync(0xff00ffffu << 8, true));
}

TEST(EmulatorFinds, AMaskWithoutTheCaller) {
  expect_fault([&] { start(masks_itself_out, 1, 32); }, "leaves out the calling lane");
}

__global__ void masks_lanes_that_left(DeviceView<int> out) {
  if (threadIdx.x >= 20) return;
  out[threadIdx.x] = __shfl_xor_sync(0xffffffffu, static_cast<int>(threadIdx.x), 1);
}

TEST(EmulatorFinds, AMaskOfLanesThatLeft) {
  std::vector<int> out(32);
  expect_fault([&] { start(masks_lanes_that_left, 1, 32, std::span(out)); }, "has left the kernel");
}

__global__ void masks_lanes_in_another_branch(DeviceView<int> out) {
  if (threadIdx.x < 16) {
    out[threadIdx.x] = __any_sync(0xffffffffu, true);
  } else {
    __syncthreads();
  }
}

TEST(EmulatorFinds, AMaskOfLanesInAnotherBranch) {
  std::vector<int> out(32);
  expect_fault([&] { start(masks_lanes_in_another_branch, 1, 32, std::span(out)); }, "waits at __syncthreads");
}

TEST(EmulatorFinds, AShuffleFromALaneThatTheMaskLeavesOut) {
  std::vector<int> out(32);
  expect_fault([&] { start(shuffle_beyond_mask, 1, 32, std::span(out)); }, "which the mask 000000ff leaves out");
}

__global__ void leaves_before_the_barrier() {
  if (threadIdx.x == 5) return;
  __syncthreads();
}

TEST(EmulatorFinds, AThreadThatLeavesBeforeABarrier) {
  expect_fault([&] { start(leaves_before_the_barrier, 1, 64); }, "left the kernel while other threads wait");
}

__global__ void two_barriers() {
  if (threadIdx.x < 32) {
    __syncthreads();
  } else {
    __syncthreads();
  }
}

TEST(EmulatorFinds, BarriersOfTwoBranches) {
  expect_fault([&] { start(two_barriers, 1, 64); }, "while thread");
}

#ifdef SPLATBOOST_WATCHES_ACCESSES  // needs the compiler's instrumentation, which sanitizers use themselves

/// Provides 128 numbers in device memory, initially zero.
class EmulatorFindsInGlobalMemory : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(cudaMalloc(reinterpret_cast<void**>(&memory_), 128 * sizeof(int)), cudaSuccess);
    ASSERT_EQ(cudaMemsetAsync(memory_, 0, 128 * sizeof(int), nullptr), cudaSuccess);
  }
  void TearDown() override { EXPECT_EQ(cudaFree(memory_), cudaSuccess); }
  DeviceView<int> numbers() { return std::span(memory_, 128); }
  int* memory_ = nullptr;
};

/// What each thread does with the numbers.
enum class Touch { read_next, write_first, add_to_first, own_twice };

template <Touch kTouch>
__global__ void touch(DeviceView<int> numbers) {
  const std::size_t i = blockIdx.x * blockDim.x + threadIdx.x;
  if (kTouch == Touch::read_next) numbers[i] = numbers[(i + 1) % 128] + 1;
  if (kTouch == Touch::write_first) numbers[0] = static_cast<int>(i);
  if (kTouch == Touch::add_to_first) atomicAdd(&numbers[0], 1);
  if (kTouch == Touch::own_twice) {
    numbers[i] += 1;
    numbers[i] *= 2;
  }
}

TEST_F(EmulatorFindsInGlobalMemory, AReadOfWhatAnotherThreadWrites) {
  expect_fault([&] { start(touch<Touch::read_next>, 1, 128, numbers()); }, "global memory");
  expect_fault([&] { start(touch<Touch::read_next>, 4, 32, numbers()); }, "global memory");
}

TEST_F(EmulatorFindsInGlobalMemory, TwoThatWriteOneNumber) {
  expect_fault([&] { start(touch<Touch::write_first>, 1, 2, numbers()); }, "with no barrier in between");
  expect_fault([&] { start(touch<Touch::write_first>, 2, 1, numbers()); }, "of another block wrote");
}

TEST_F(EmulatorFindsInGlobalMemory, NothingInAtomicsAndInWhatIsAThreadsOwn) {
  start(touch<Touch::add_to_first>, 4, 32, numbers());
  start(touch<Touch::own_twice>, 4, 32, numbers());
  int first = 0;
  ASSERT_EQ(cudaMemcpyAsync(&first, memory_, sizeof first, cudaMemcpyDeviceToHost, nullptr), cudaSuccess);
  EXPECT_EQ(first, 2 * (128 + 1));
}

__global__ void add_and_read(DeviceView<int> numbers) {
  atomicAdd(&numbers[0], 1);
  numbers[1 + threadIdx.x] = numbers[0];
}

TEST_F(EmulatorFindsInGlobalMemory, APlainReadBesideAtomics) {
  expect_fault([&] { start(add_and_read, 1, 64, numbers()); }, "global memory");
}

/// All threads add to the first number; one thread also reads it afterwards, or writes it before or afterwards.
enum class Beside { reads, writes_before, writes_behind };

template <Beside kBeside>
__global__ void beside_atomics(DeviceView<int> numbers) {
  const bool one = blockIdx.x + 1 == gridDim.x && threadIdx.x == 0;
  if (kBeside == Beside::writes_before && one) numbers[0] = 0;
  __syncthreads();
  atomicAdd(&numbers[0], 1);
  __syncthreads();
  if (kBeside == Beside::reads && one) numbers[1] = numbers[0];
  if (kBeside == Beside::writes_behind && one) numbers[0] = 0;
}

TEST_F(EmulatorFindsInGlobalMemory, APlainAccessBesideAtomicsOfOtherBlocks) {
  expect_fault([&] { start(beside_atomics<Beside::reads>, 4, 32, numbers()); }, "of another block");
  expect_fault([&] { start(beside_atomics<Beside::writes_before>, 4, 32, numbers()); }, "of another block");
  expect_fault([&] { start(beside_atomics<Beside::writes_behind>, 4, 32, numbers()); }, "of another block");
  start(beside_atomics<Beside::reads>, 1, 64, numbers());
  start(beside_atomics<Beside::writes_before>, 1, 64, numbers());
  start(beside_atomics<Beside::writes_behind>, 1, 64, numbers());
}

template <bool kWarpSync>
__global__ void read_then_write(DeviceView<int> numbers) {
  numbers[64 + threadIdx.x] = numbers[0];
  if (kWarpSync) __syncwarp();
  if (threadIdx.x == 0) numbers[0] = 1;
}

TEST_F(EmulatorFindsInGlobalMemory, AWriteOfWhatAWarpReads) {
  start(read_then_write<true>, 1, 32, numbers());
  expect_fault([&] { start(read_then_write<false>, 1, 32, numbers()); }, "with no barrier in between");
  expect_fault([&] { start(read_then_write<true>, 1, 64, numbers()); }, "with no barrier in between");
}

__global__ void write_parts(DeviceView<int> numbers) {
  if (threadIdx.x == 0) numbers[0] = 1;
  if (threadIdx.x == 1) reinterpret_cast<unsigned char*>(&numbers[0])[3] = 1;
}

TEST_F(EmulatorFindsInGlobalMemory, AWriteOfAPartOfWhatAnotherWrites) {
  expect_fault([&] { start(write_parts, 1, 32, numbers()); }, "global memory");
}

TEST_F(EmulatorFindsInGlobalMemory, WhatWasGivenBack) {
  void* gone = nullptr;
  ASSERT_EQ(cudaMalloc(&gone, 128 * sizeof(int)), cudaSuccess);
  const DeviceView<int> numbers = std::span(static_cast<int*>(gone), 128);
  start(write_index, 4, 32, numbers);
  ASSERT_EQ(cudaFree(gone), cudaSuccess);
  expect_fault([&] { start(touch<Touch::own_twice>, 1, 1, numbers); }, "nobody wrote");
}

template <bool kBarrier, bool kWarpSync>
__global__ void exchange_in_global(DeviceView<int> numbers) {
  numbers[threadIdx.x] = static_cast<int>(threadIdx.x);
  if (kBarrier) __syncthreads();
  if (kWarpSync) __syncwarp();
  const int other = numbers[threadIdx.x ^ 1];
  if (kBarrier) __syncthreads();
  if (kWarpSync) __syncwarp();
  numbers[threadIdx.x] = other;
}

TEST_F(EmulatorFindsInGlobalMemory, AMissingBarrier) {
  start(exchange_in_global<true, false>, 1, 64, numbers());
  start(exchange_in_global<false, true>, 1, 64, numbers());
  expect_fault([&] { start(exchange_in_global<false, false>, 1, 64, numbers()); }, "with no barrier in between");
  // A barrier does not synchronize blocks.
  expect_fault([&] { start(exchange_in_global<true, false>, 2, 64, numbers()); }, "of another block");
}

TEST_F(EmulatorFindsInGlobalMemory, WhatNobodyWrote) {
  void* fresh = nullptr;
  ASSERT_EQ(cudaMalloc(&fresh, 128 * sizeof(int)), cudaSuccess);
  const DeviceView<int> numbers = std::span(static_cast<int*>(fresh), 128);
  expect_fault([&] { start(touch<Touch::own_twice>, 4, 32, numbers); }, "nobody wrote");
  expect_fault([&] { start(touch<Touch::add_to_first>, 4, 32, numbers); }, "nobody wrote");
  int value = 0;
  EXPECT_THROW(static_cast<void>(cudaMemcpyAsync(&value, fresh, sizeof value, cudaMemcpyDeviceToHost, nullptr)),
               cuda_on_cpu::Fault);
  start(write_index, 4, 32, numbers);
  start(touch<Touch::own_twice>, 4, 32, numbers);
  ASSERT_EQ(cudaFree(fresh), cudaSuccess);
}

#endif

TEST(Emulator, RefusesShapesThatADeviceWould) {
  cudaLaunchConfig_t shape{};
  shape.gridDim = dim3(1);
  shape.blockDim = dim3(1025);
  EXPECT_EQ(cudaLaunchKernelEx(&shape, two_barriers), cudaErrorInvalidConfiguration);
  shape.blockDim = dim3(0);
  EXPECT_EQ(cudaLaunchKernelEx(&shape, two_barriers), cudaErrorInvalidConfiguration);
}

// ---- memory, and CUB

TEST(EmulatorMemory, IsLimitedAndNotZero) {
  void* memory = nullptr;
  cuda_on_cpu::set_device_memory(1 << 20);
  EXPECT_EQ(cudaMalloc(&memory, (1 << 20) + 1), cudaErrorMemoryAllocation);
  ASSERT_EQ(cudaMalloc(&memory, 1 << 19), cudaSuccess);
  EXPECT_EQ(cuda_on_cpu::device_memory_in_use(), std::size_t{1} << 19);
#ifndef SPLATBOOST_WATCHES_ACCESSES  // with them this is a fault
  float value = 0;
  EXPECT_EQ(cudaMemcpyAsync(&value, memory, sizeof value, cudaMemcpyDeviceToHost, nullptr), cudaSuccess);
  EXPECT_TRUE(std::isnan(value));
#endif
  EXPECT_EQ(cudaFree(memory), cudaSuccess);
  EXPECT_EQ(cudaFree(memory), cudaErrorInvalidValue);  // twice
  cuda_on_cpu::set_device_memory(std::size_t{4} << 30);
}

TEST(EmulatorMemory, IsNotTheHosts) {
  void* memory = nullptr;
  ASSERT_EQ(cudaMalloc(&memory, 100), cudaSuccess);
  EXPECT_DEATH(*static_cast<volatile int*>(memory) = 1, "");
  EXPECT_EQ(cudaMemsetAsync(memory, 0, 100, nullptr), cudaSuccess);
  EXPECT_DEATH(*static_cast<volatile int*>(memory) = 1, "") << "nor after the device has used it";
  EXPECT_EQ(cudaFree(memory), cudaSuccess);
}

TEST(EmulatorMemory, IsFoundAgainWhenItWasGivenBack) {
  std::vector<void*> pieces(20);
  for (int round = 0; round < 3; ++round) {
    for (std::size_t i = 0; i < pieces.size(); ++i) {
      ASSERT_EQ(cudaMalloc(&pieces[i], 5000 * (i + 1)), cudaSuccess);
      ASSERT_EQ(cudaMemsetAsync(pieces[i], static_cast<int>(i), 5000 * (i + 1), nullptr), cudaSuccess);
    }
    for (std::size_t i = 0; i < pieces.size(); ++i) {
      std::vector<unsigned char> there(5000 * (i + 1));
      ASSERT_EQ(cudaMemcpyAsync(there.data(), pieces[i], there.size(), cudaMemcpyDeviceToHost, nullptr), cudaSuccess);
      EXPECT_EQ(std::count(there.begin(), there.end(), static_cast<unsigned char>(i)),
                static_cast<std::ptrdiff_t>(there.size()));
    }
    for (std::size_t i = 0; i < pieces.size(); ++i) EXPECT_EQ(cudaFree(pieces[i * 7 % pieces.size()]), cudaSuccess);
  }
  EXPECT_EQ(cuda_on_cpu::device_memory_in_use(), 0u);
}

// ---- streams: detecting what the host does too early

/// Provides device memory, pinned host memory, streams and an event.
class EmulatorStreams : public ::testing::Test {
 protected:
  static constexpr std::size_t kNumbers = 64;
  static constexpr std::size_t kBytes = kNumbers * sizeof(int);
  void SetUp() override {
    lag_before_ = cuda_on_cpu::set_lag(std::numeric_limits<std::size_t>::max());
    ASSERT_EQ(cudaMalloc(reinterpret_cast<void**>(&device_), kBytes), cudaSuccess);
    ASSERT_EQ(cudaMallocHost(reinterpret_cast<void**>(&pinned_), kBytes), cudaSuccess);
    for (cudaStream_t& stream : streams_) {
      ASSERT_EQ(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking), cudaSuccess);
    }
    ASSERT_EQ(cudaEventCreateWithFlags(&event_, cudaEventDefault), cudaSuccess);
  }
  void TearDown() override {
    cuda_on_cpu::set_lag(lag_before_);
    EXPECT_EQ(cudaEventDestroy(event_), cudaSuccess);
    for (const cudaStream_t stream : streams_) EXPECT_EQ(cudaStreamDestroy(stream), cudaSuccess);
    EXPECT_EQ(cudaFreeHost(pinned_), cudaSuccess);
    EXPECT_EQ(cudaFree(device_), cudaSuccess);
  }
  /// Launches a kernel in a stream without waiting for it.
  template <class... Parameters, class... Arguments>
  void give(cudaStream_t stream, void (*kernel)(Parameters...), Arguments&&... arguments) {
    cudaLaunchConfig_t shape{};
    shape.gridDim = dim3(1);
    shape.blockDim = dim3(kNumbers);
    shape.stream = stream;
    ASSERT_EQ(cudaLaunchKernelEx(&shape, kernel, std::forward<Arguments>(arguments)...), cudaSuccess);
  }
  void copy(void* to, const void* from, cudaMemcpyKind kind, cudaStream_t stream) {
    ASSERT_EQ(cudaMemcpyAsync(to, from, kBytes, kind, stream), cudaSuccess);
  }
  DeviceView<int> numbers() { return std::span(device_, kNumbers); }

  std::size_t lag_before_ = 0;
  int* device_ = nullptr;
  int* pinned_ = nullptr;
  cudaStream_t streams_[2] = {};
  cudaEvent_t event_ = nullptr;
};

TEST_F(EmulatorStreams, DoNothingBeforeTheHostWaits) {
  give(streams_[0], write_index, numbers());
  copy(pinned_, device_, cudaMemcpyDeviceToHost, streams_[0]);
  ASSERT_EQ(cudaEventRecord(event_, streams_[0]), cudaSuccess);
  EXPECT_EQ(cudaEventQuery(event_), cudaErrorNotReady);
  EXPECT_EQ(pinned_[5], -1) << "read too early";
  float milliseconds = 0;
  EXPECT_EQ(cudaEventElapsedTime(&milliseconds, event_, event_), cudaErrorNotReady);
  ASSERT_EQ(cudaEventSynchronize(event_), cudaSuccess);
  EXPECT_EQ(cudaEventQuery(event_), cudaSuccess);
  EXPECT_EQ(pinned_[5], 5);
}

TEST_F(EmulatorStreams, AreBehindByTheLagAtMost) {
  cuda_on_cpu::set_lag(1);
  give(streams_[0], write_index, numbers());
  copy(pinned_, device_, cudaMemcpyDeviceToHost, streams_[0]);
  EXPECT_EQ(pinned_[5], -1);
  ASSERT_EQ(cudaMemsetAsync(device_, 0, kBytes, streams_[0]), cudaSuccess);
  EXPECT_EQ(pinned_[5], 5);
  cuda_on_cpu::set_lag(0);
  copy(pinned_, device_, cudaMemcpyDeviceToHost, streams_[0]);
  EXPECT_EQ(pinned_[5], 0);
}

TEST_F(EmulatorStreams, ReadPinnedMemoryWhenTheirTurnComesAndOtherMemoryAtOnce) {
  std::vector<int> pageable(kNumbers, 7), back(kNumbers, 0);
  copy(device_, pageable.data(), cudaMemcpyHostToDevice, streams_[0]);
  pageable.assign(kNumbers, 8);
  copy(back.data(), device_, cudaMemcpyDeviceToHost, streams_[0]);
  EXPECT_EQ(back, std::vector<int>(kNumbers, 7));
  std::fill_n(pinned_, kNumbers, 7);
  copy(device_, pinned_, cudaMemcpyHostToDevice, streams_[0]);
  std::fill_n(pinned_, kNumbers, 8);  // too early
  copy(back.data(), device_, cudaMemcpyDeviceToHost, streams_[0]);
  EXPECT_EQ(back, std::vector<int>(kNumbers, 8));
}

TEST_F(EmulatorStreams, WaitForEventsOfOthersAndForNothingElse) {
  ASSERT_EQ(cudaMemsetAsync(device_, 0, kBytes, streams_[0]), cudaSuccess);
  ASSERT_EQ(cudaEventRecord(event_, streams_[0]), cudaSuccess);
  give(streams_[0], write_index, numbers());
  ASSERT_EQ(cudaStreamWaitEvent(streams_[1], event_, 0), cudaSuccess);
  copy(pinned_, device_, cudaMemcpyDeviceToHost, streams_[1]);
  ASSERT_EQ(cudaStreamSynchronize(streams_[1]), cudaSuccess);
  EXPECT_EQ(pinned_[5], 0) << "the kernel comes after the event";
  copy(pinned_, device_, cudaMemcpyDeviceToHost, streams_[1]);
  ASSERT_EQ(cudaStreamSynchronize(streams_[1]), cudaSuccess);
  EXPECT_EQ(pinned_[5], 0) << "nobody waited for the kernel";
}

TEST_F(EmulatorStreams, ThrowFaultsWhereTheHostWaits) {
  std::vector<int> few(10);
  for (const bool from_giving_back : {false, true}) {
    give(streams_[0], write_index, numbers());
    give(streams_[0], writes_beyond, std::span(few));
    if (from_giving_back) {  // cudaFree must not throw; the next call does
      void* memory = nullptr;
      ASSERT_EQ(cudaMalloc(&memory, 1), cudaSuccess);
      ASSERT_EQ(cudaFree(memory), cudaSuccess);
    }
    EXPECT_THROW(static_cast<void>(cudaStreamSynchronize(streams_[0])), cuda_on_cpu::Fault);
    EXPECT_EQ(cudaStreamSynchronize(streams_[0]), cudaSuccess);
  }
  // Nor does cudaEventRecord throw, because destructors call it.
  cuda_on_cpu::set_lag(1);
  give(streams_[0], writes_beyond, std::span(few));
  EXPECT_EQ(cudaEventRecord(event_, streams_[0]), cudaSuccess);
  EXPECT_THROW(static_cast<void>(cudaEventQuery(event_)), cuda_on_cpu::Fault);
  cuda_on_cpu::set_lag(0);
  EXPECT_THROW(give(streams_[0], writes_beyond, std::span(few)), cuda_on_cpu::Fault);
}

TEST(EmulatorCub, SortsStablyByTheBitsAskedFor) {
  const std::vector<float> keys{2.0f, -1.0f, 0.5f, -3.0f, 2.0f};
  const std::vector<int> values{0, 1, 2, 3, 4};
  std::vector<float> sorted(5);
  std::vector<int> moved(5);
  std::size_t bytes = 0;
  cub::DeviceRadixSort::SortPairs(nullptr, bytes, keys.data(), sorted.data(), values.data(), moved.data(), 5);
  std::vector<char> memory(bytes);
  cub::DeviceRadixSort::SortPairs(memory.data(), bytes, keys.data(), sorted.data(), values.data(), moved.data(), 5);
  ASSERT_EQ(cudaStreamSynchronize(nullptr), cudaSuccess);
  EXPECT_EQ(moved, (std::vector<int>{3, 1, 2, 0, 4}));
  EXPECT_EQ(sorted, (std::vector<float>{-3, -1, 0.5f, 2, 2}));
  std::vector<std::uint32_t> bits{0x13, 0x01, 0x22, 0x12};
  std::vector<int> at{0, 1, 2, 3}, bits_moved(4);
  std::vector<std::uint32_t> bits_sorted(4);
  cub::DeviceRadixSort::SortPairs(memory.data(), bytes, bits.data(), bits_sorted.data(), at.data(), bits_moved.data(),
                                  4, 0, 4);
  ASSERT_EQ(cudaStreamSynchronize(nullptr), cudaSuccess);
  EXPECT_EQ(bits_moved, (std::vector<int>{1, 2, 3, 0}));
}

}  // namespace
}  // namespace splatboost::test
