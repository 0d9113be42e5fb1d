// SPDX-License-Identifier: Apache-2.0
/// @file Memory access in kernels: views of device memory, and shared-memory arrays of a block. For .cu files. With
/// nvcc they compile to plain pointers; the emulator (tests/cuda_on_cpu) checks every access.
#pragma once

#include <cuda_runtime.h>

#include <cstddef>
#include <span>
#include <type_traits>

namespace splatboost {

/// A span of device memory, which the host passes to a kernel.
template <class T>
class DeviceView {
 public:
  DeviceView() = default;
  template <class U>
  requires std::is_convertible_v<U (*)[], T (*)[]> DeviceView(std::span<U> span)
      : data_(span.data()), size_(span.size()) {}  // NOLINT: a view of it

  __host__ __device__ bool empty() const { return size_ == 0; }
  __host__ __device__ std::size_t size() const { return size_; }

  __device__ T& operator[](std::size_t i) const {
#ifdef SPLATBOOST_CUDA_ON_CPU
    cuda_on_cpu::check_bounds(i, size_);
#endif
    return data_[i];
  }

 private:
  T* data_ = nullptr;
  std::size_t size_ = 0;
};

/// An array in shared memory: `__shared__ SharedArray<float, 256> name;`. Reads and writes are separate functions, so
/// that the emulator can detect a missing __syncthreads().
template <class T, int N>
class SharedArray {
 public:
  __device__ T get(int i) const {
#ifdef SPLATBOOST_CUDA_ON_CPU
    accesses_.read(i);
#endif
    return values_[i];
  }
  __device__ void set(int i, T value) {
#ifdef SPLATBOOST_CUDA_ON_CPU
    accesses_.write(i);
#endif
    values_[i] = value;
  }
  /// Atomic addition.
  __device__ void add(int i, T value) {
#ifdef SPLATBOOST_CUDA_ON_CPU
    accesses_.add(i);
#endif
    atomicAdd(&values_[i], value);
  }

 private:
  T values_[N];
#ifdef SPLATBOOST_CUDA_ON_CPU
  mutable cuda_on_cpu::SharedAccesses accesses_{N};
#endif
};

}  // namespace splatboost
