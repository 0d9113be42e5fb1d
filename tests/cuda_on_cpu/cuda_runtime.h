// SPDX-License-Identifier: Apache-2.0
/// @file Replaces the CUDA toolkit's header of this name: the part of the language and the runtime that the .cu files
/// use, on the CPU. See cuda_on_cpu.h.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <type_traits>
#include <utility>
#include <vector>

#include "cuda_on_cpu.h"

#define __global__
#define __device__
#define __host__
#define __forceinline__ inline
#define __constant__ static
#define __launch_bounds__(...)
#define __shared__ static  // blocks run one after another

struct uint2 {
  unsigned x, y;
};
struct uint3 {
  unsigned x, y, z;
};
struct uint4 {
  unsigned x, y, z, w;
};
struct int2 {
  int x, y;
};
struct float2 {
  float x, y;
};
struct float3 {
  float x, y, z;
};
struct alignas(16) float4 {
  float x, y, z, w;
};
inline float2 make_float2(float x, float y) { return {x, y}; }
inline float3 make_float3(float x, float y, float z) { return {x, y, z}; }
inline float4 make_float4(float x, float y, float z, float w) { return {x, y, z, w}; }
inline uint2 make_uint2(unsigned x, unsigned y) { return {x, y}; }

struct dim3 {
  unsigned x, y, z;
  dim3(unsigned x_ = 1, unsigned y_ = 1, unsigned z_ = 1) : x(x_), y(y_), z(z_) {}
};

// ---- errors

enum cudaError_t : int {
  cudaSuccess = 0,
  cudaErrorInvalidValue = 1,
  cudaErrorMemoryAllocation = 2,
  cudaErrorInvalidConfiguration = 9,
  cudaErrorNoDevice = 100,
  cudaErrorInvalidDevice = 101,
  cudaErrorNotReady = 600,
};
const char* cudaGetErrorString(cudaError_t error);
inline cudaError_t cudaGetLastError() { return cudaSuccess; }
inline cudaError_t cudaPeekAtLastError() { return cudaSuccess; }

// ---- devices, memory, streams, events

struct cudaDeviceProp {
  char name[256];
  std::size_t totalGlobalMem;
  int major, minor;
};
cudaError_t cudaGetDeviceCount(int* count);
cudaError_t cudaGetDeviceProperties(cudaDeviceProp* properties, int device);
cudaError_t cudaGetDevice(int* device);
cudaError_t cudaSetDevice(int device);
enum cudaDeviceAttr { cudaDevAttrPageableMemoryAccessUsesHostPageTables };
inline cudaError_t cudaDeviceGetAttribute(int* value, cudaDeviceAttr, int) {
  *value = 0;
  return cudaSuccess;
}
cudaError_t cudaDriverGetVersion(int* version);
cudaError_t cudaRuntimeGetVersion(int* version);

cudaError_t cudaMalloc(void** memory, std::size_t bytes);
cudaError_t cudaFree(void* memory);
cudaError_t cudaMemGetInfo(std::size_t* free, std::size_t* total);
cudaError_t cudaMallocHost(void** memory, std::size_t bytes);
cudaError_t cudaFreeHost(void* memory);

using cudaStream_t = struct CudaOnCpuStream*;
inline constexpr unsigned cudaStreamNonBlocking = 1;
cudaError_t cudaStreamCreateWithFlags(cudaStream_t* stream, unsigned flags);
cudaError_t cudaStreamDestroy(cudaStream_t stream);
cudaError_t cudaStreamSynchronize(cudaStream_t stream);

enum cudaMemcpyKind { cudaMemcpyHostToDevice, cudaMemcpyDeviceToHost, cudaMemcpyDeviceToDevice };
cudaError_t cudaMemcpyAsync(void* to, const void* from, std::size_t bytes, cudaMemcpyKind kind, cudaStream_t stream);
cudaError_t cudaMemsetAsync(void* memory, int byte, std::size_t bytes, cudaStream_t stream);

using cudaEvent_t = struct CudaOnCpuEvent*;
inline constexpr unsigned cudaEventDefault = 0, cudaEventDisableTiming = 2;
cudaError_t cudaEventCreateWithFlags(cudaEvent_t* event, unsigned flags);
cudaError_t cudaEventDestroy(cudaEvent_t event);
cudaError_t cudaEventRecord(cudaEvent_t event, cudaStream_t stream);
cudaError_t cudaStreamWaitEvent(cudaStream_t stream, cudaEvent_t event, unsigned flags);
cudaError_t cudaEventQuery(cudaEvent_t event);
cudaError_t cudaEventSynchronize(cudaEvent_t event);
cudaError_t cudaEventElapsedTime(float* milliseconds, cudaEvent_t from, cudaEvent_t to);

// ---- threads of a kernel

namespace cuda_on_cpu {

enum class WarpFunction { sync, shuffle, ballot, any, all, add, min, max, bit_and, bit_or };
/// Waits until all lanes of the mask have called the same function. @param source lane whose value a shuffle reads
/// @return the result for the calling lane
std::uint64_t warp_call(WarpFunction function, unsigned mask, std::uint64_t value, int source);
int lane();
/// @param line source line, which identifies the barrier @return sum of the values over the block
int block_barrier(int line, int value);

[[noreturn]] void fault(const char* format, ...) __attribute__((format(printf, 1, 2)));
inline void check_bounds(std::size_t i, std::size_t size) {
  if (i >= size) fault("index %zu of a view of %zu elements", i, size);
}

/// Tracks which thread accessed which element of an array in shared memory since the last barrier.
class SharedAccesses {
 public:
  explicit SharedAccesses(int size) : cells_(static_cast<std::size_t>(size)) {}
  void read(int i);
  void write(int i) { change(i, false); }
  void add(int i) { change(i, true); }

 private:
  static constexpr int kWarps = 32;
  struct Access {
    std::uint64_t block_epoch = 0, warp_epoch = 0;
    int thread = -1;  ///< −2: several threads of a warp
    bool atomic = false;
  };
  struct Cell {
    Access write;
    Access reads[kWarps];
  };
  void change(int i, bool atomic);
  Cell& cell(int i);
  void check_order(const Access& write, const char* what, int i) const;
  std::vector<Cell> cells_;
};

/// Queues work in the stream, which executes it when the host waits for it. Faults are thrown there, not here.
void give_work(cudaStream_t stream, std::function<void()> work);
/// Executes the work of all streams, as a device does before it frees memory. A fault is thrown by the next call.
void finish_everything() noexcept;
/// Whether this is host memory that is not pinned.
bool is_pageable(const void* memory);
/// Record accesses to device memory by work other than kernels, which the compiler does not instrument.
void note_read(const void* memory, std::size_t bytes);
void note_written(const void* memory, std::size_t bytes);
/// Makes device memory accessible during its lifetime, for kernels and copies.
class DeviceAccess {
 public:
  DeviceAccess();
  ~DeviceAccess();
  DeviceAccess(const DeviceAccess&) = delete;
  DeviceAccess& operator=(const DeviceAccess&) = delete;
};

bool is_valid_shape(dim3 blocks, dim3 threads);
/// Runs a grid of a valid shape.
void run(dim3 blocks, dim3 threads, const std::function<void()>& kernel);

template <class T>
std::uint64_t to_bits(T value) {
  static_assert(sizeof(T) <= 8 && std::is_trivially_copyable_v<T>);
  std::uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof value);
  return bits;
}
template <class T>
T from_bits(std::uint64_t bits) {
  T value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}
template <class T>
T shuffle(unsigned mask, T value, int source) {
  return from_bits<T>(warp_call(WarpFunction::shuffle, mask, to_bits(value), source));
}
/// Records an atomic access to device memory, if accesses are instrumented (accesses.cpp).
void note_atomic(const void* at, std::size_t bytes);
/// Not instrumented by the compiler: note_atomic() records the access instead.
template <class T, class Next>
__attribute__((no_sanitize("thread"))) T atomically(T* at, const Next& next) {
  note_atomic(at, sizeof(T));
  const T before = *at;
  *at = static_cast<T>(next(before));
  return before;
}

}  // namespace cuda_on_cpu

// Built-in variables of the running thread.
inline uint3 threadIdx{}, blockIdx{};
inline dim3 blockDim, gridDim;
inline constexpr int warpSize = 32;

#define __syncthreads() static_cast<void>(::cuda_on_cpu::block_barrier(__LINE__, 0))
#define __syncthreads_count(condition) ::cuda_on_cpu::block_barrier(__LINE__, (condition) ? 1 : 0)
#define __syncthreads_or(condition) (::cuda_on_cpu::block_barrier(__LINE__, (condition) ? 1 : 0) > 0)

inline void __syncwarp(unsigned mask = 0xffffffffu) {
  cuda_on_cpu::warp_call(cuda_on_cpu::WarpFunction::sync, mask, 0, 0);
}
template <class T>
T __shfl_sync(unsigned mask, T value, int source) {
  return cuda_on_cpu::shuffle(mask, value, source & 31);
}
template <class T>
T __shfl_xor_sync(unsigned mask, T value, int bits) {
  return cuda_on_cpu::shuffle(mask, value, cuda_on_cpu::lane() ^ bits);
}
template <class T>
T __shfl_down_sync(unsigned mask, T value, unsigned by) {
  const int source = cuda_on_cpu::lane() + static_cast<int>(by);
  return cuda_on_cpu::shuffle(mask, value, source < 32 ? source : cuda_on_cpu::lane());
}
template <class T>
T __shfl_up_sync(unsigned mask, T value, unsigned by) {
  const int source = cuda_on_cpu::lane() - static_cast<int>(by);
  return cuda_on_cpu::shuffle(mask, value, source >= 0 ? source : cuda_on_cpu::lane());
}
inline unsigned __ballot_sync(unsigned mask, bool condition) {
  return static_cast<unsigned>(cuda_on_cpu::warp_call(cuda_on_cpu::WarpFunction::ballot, mask, condition ? 1 : 0, 0));
}
inline bool __any_sync(unsigned mask, bool condition) {
  return cuda_on_cpu::warp_call(cuda_on_cpu::WarpFunction::any, mask, condition ? 1 : 0, 0) != 0;
}
inline bool __all_sync(unsigned mask, bool condition) {
  return cuda_on_cpu::warp_call(cuda_on_cpu::WarpFunction::all, mask, condition ? 1 : 0, 0) != 0;
}
// For 32-bit integers. Devices below compute capability 8.0 do not have these.
inline unsigned __reduce_add_sync(unsigned mask, unsigned value) {
  return static_cast<unsigned>(cuda_on_cpu::warp_call(cuda_on_cpu::WarpFunction::add, mask, value, 0));
}
inline unsigned __reduce_min_sync(unsigned mask, unsigned value) {
  return static_cast<unsigned>(cuda_on_cpu::warp_call(cuda_on_cpu::WarpFunction::min, mask, value, 0));
}
inline unsigned __reduce_max_sync(unsigned mask, unsigned value) {
  return static_cast<unsigned>(cuda_on_cpu::warp_call(cuda_on_cpu::WarpFunction::max, mask, value, 0));
}
inline unsigned __reduce_and_sync(unsigned mask, unsigned value) {
  return static_cast<unsigned>(cuda_on_cpu::warp_call(cuda_on_cpu::WarpFunction::bit_and, mask, value, 0));
}
inline unsigned __reduce_or_sync(unsigned mask, unsigned value) {
  return static_cast<unsigned>(cuda_on_cpu::warp_call(cuda_on_cpu::WarpFunction::bit_or, mask, value, 0));
}

template <class T>
T atomicAdd(T* at, std::type_identity_t<T> value) {
  return cuda_on_cpu::atomically(at, [value](T now) { return now + value; });
}
template <class T>
T atomicMax(T* at, std::type_identity_t<T> value) {
  return cuda_on_cpu::atomically(at, [value](T now) { return std::max(now, value); });
}
template <class T>
T atomicMin(T* at, std::type_identity_t<T> value) {
  return cuda_on_cpu::atomically(at, [value](T now) { return std::min(now, value); });
}
template <class T>
T atomicOr(T* at, std::type_identity_t<T> value) {
  return cuda_on_cpu::atomically(at, [value](T now) { return now | value; });
}
template <class T>
T atomicExch(T* at, std::type_identity_t<T> value) {
  return cuda_on_cpu::atomically(at, [value](T) { return value; });
}
template <class T>
T atomicCAS(T* at, std::type_identity_t<T> expected, std::type_identity_t<T> value) {
  return cuda_on_cpu::atomically(at, [expected, value](T now) { return now == expected ? value : now; });
}

using std::max;
using std::min;
template <class T>
T __ldg(const T* at) {
  return *at;
}
inline int __popc(unsigned bits) { return std::popcount(bits); }
inline int __clz(int bits) { return std::countl_zero(static_cast<unsigned>(bits)); }
inline int __ffs(int bits) { return bits == 0 ? 0 : std::countr_zero(static_cast<unsigned>(bits)) + 1; }
inline unsigned __float_as_uint(float value) { return std::bit_cast<unsigned>(value); }
inline float __uint_as_float(unsigned bits) { return std::bit_cast<float>(bits); }
inline int __float_as_int(float value) { return std::bit_cast<int>(value); }
inline float __int_as_float(int bits) { return std::bit_cast<float>(bits); }
namespace cuda_on_cpu {
/// Returns the value through an optimization barrier, so that the compiler does not fuse operations across it.
template <class T>
T rounded(T value) {
  asm volatile("" : "+m"(value));
  return value;
}
/// A result as inexact as that of a special function unit: subnormal numbers become 0, and the last bits vary.
inline float approximate(float exact) {
  if (!std::isnormal(exact)) return std::abs(exact) < 1 ? std::copysign(0.0f, exact) : exact;
  const auto bits = std::bit_cast<unsigned>(exact);
  return std::bit_cast<float>(bits + (bits * 2654435761u >> 30) - 1);  // from one ulp down to two up
}
}  // namespace cuda_on_cpu

// Each operation rounds separately and is never fused.
inline float __fmul_rn(float a, float b) { return cuda_on_cpu::rounded(a * b); }
inline float __fadd_rn(float a, float b) { return cuda_on_cpu::rounded(a + b); }
inline double __dmul_rn(double a, double b) { return cuda_on_cpu::rounded(a * b); }
inline double __dadd_rn(double a, double b) { return cuda_on_cpu::rounded(a + b); }
inline float __fdividef(float a, float b) { return a / b; }
inline float __saturatef(float a) { return std::min(std::max(a, 0.0f), 1.0f); }
inline float rsqrtf(float a) { return 1.0f / std::sqrt(a); }

// ---- launches

struct cudaLaunchConfig_t {
  dim3 gridDim, blockDim;
  std::size_t dynamicSmemBytes = 0;  // not supported here: shared arrays are of fixed sizes
  cudaStream_t stream = nullptr;
};
template <class... Parameters, class... Arguments>
cudaError_t cudaLaunchKernelEx(const cudaLaunchConfig_t* config, void (*kernel)(Parameters...),
                               Arguments&&... arguments) {
  const dim3 blocks = config->gridDim, threads = config->blockDim;
  if (config->dynamicSmemBytes != 0 || !cuda_on_cpu::is_valid_shape(blocks, threads)) {
    return cudaErrorInvalidConfiguration;
  }
  // The arguments are copied now, and every thread gets its own copy, as on a device.
  std::function<void()> thread =
      std::bind_front(kernel, static_cast<Parameters>(std::forward<Arguments>(arguments))...);
  cuda_on_cpu::give_work(config->stream,
                         [=, thread = std::move(thread)] { cuda_on_cpu::run(blocks, threads, thread); });
  return cudaSuccess;
}
