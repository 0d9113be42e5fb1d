// SPDX-License-Identifier: Apache-2.0
/// @file Replaces CUB's header of this name: the device-wide functions that the .cu files call, implemented with the
/// standard library. As in CUB, a call without temporary memory only returns how much is needed.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <numeric>
#include <type_traits>
#include <vector>

#include "../cuda_runtime.h"

namespace cub {

template <class T>
struct DoubleBuffer {
  T* d_buffers[2];
  int selector = 0;
  DoubleBuffer(T* current, T* alternate) : d_buffers{current, alternate} {}
  T* Current() const { return d_buffers[selector]; }
  T* Alternate() const { return d_buffers[selector ^ 1]; }
};

namespace detail_on_cpu {
/// Whether the call only asks for the size of temporary memory.
inline bool asks_for_size(const void* memory, std::size_t& bytes) {
  if (memory != nullptr) return false;
  bytes = 1;
  return true;
}
/// A key's bits [begin, end), transformed so that their order is that of CUB: floats are ordered by value.
template <class Key>
std::uint64_t sort_bits(Key key, int begin, int end) {
  std::uint64_t bits = cuda_on_cpu::to_bits(key);
  const int width = 8 * static_cast<int>(sizeof(Key));
  const std::uint64_t top = std::uint64_t{1} << (width - 1);
  if constexpr (std::is_floating_point_v<Key>) {
    bits = (bits & top) != 0 ? ~bits : bits | top;
  } else if constexpr (std::is_signed_v<Key>) {
    bits ^= top;
  }
  bits >>= begin;
  return end - begin >= 64 ? bits : bits & ((std::uint64_t{1} << (end - begin)) - 1);
}
template <class Key>
std::vector<std::size_t> sorted(const Key* keys, std::size_t n, int begin, int end) {
  std::vector<std::size_t> order(n);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return sort_bits(keys[a], begin, end) < sort_bits(keys[b], begin, end);
  });
  return order;
}
template <class T>
void gather(const T* from, T* to, const std::vector<std::size_t>& order) {
  std::vector<T> result;
  for (const std::size_t i : order) result.push_back(from[i]);
  std::copy(result.begin(), result.end(), to);
  cuda_on_cpu::note_written(to, order.size() * sizeof(T));
}
}  // namespace detail_on_cpu

struct DeviceRadixSort {
  template <class Key, class Value>
  static cudaError_t SortPairs(void* memory, std::size_t& bytes, const Key* keys_in, Key* keys_out,
                               const Value* values_in, Value* values_out, std::int64_t n, int begin_bit = 0,
                               int end_bit = 8 * static_cast<int>(sizeof(Key)), cudaStream_t stream = nullptr) {
    if (detail_on_cpu::asks_for_size(memory, bytes)) return cudaSuccess;
    cuda_on_cpu::give_work(stream, [=] {
      const cuda_on_cpu::DeviceAccess access;
      const auto order = detail_on_cpu::sorted(keys_in, static_cast<std::size_t>(n), begin_bit, end_bit);
      detail_on_cpu::gather(values_in, values_out, order);
      detail_on_cpu::gather(keys_in, keys_out, order);
    });
    return cudaSuccess;
  }
  template <class Key, class Value>
  static cudaError_t SortPairs(void* memory, std::size_t& bytes, DoubleBuffer<Key>& keys, DoubleBuffer<Value>& values,
                               std::int64_t n, int begin_bit = 0, int end_bit = 8 * static_cast<int>(sizeof(Key)),
                               cudaStream_t stream = nullptr) {
    if (detail_on_cpu::asks_for_size(memory, bytes)) return cudaSuccess;
    // As in CUB, one pass per byte, alternating between the buffers: the number of passes decides where the result is.
    const int turns = (end_bit - begin_bit + 7) / 8 % 2;
    const Key* const keys_in = keys.Current();
    const Value* const values_in = values.Current();
    keys.selector ^= turns;
    values.selector ^= turns;
    return SortPairs(memory, bytes, keys_in, keys.Current(), values_in, values.Current(), n, begin_bit, end_bit,
                     stream);
  }
  template <class Key>
  static cudaError_t SortKeys(void* memory, std::size_t& bytes, const Key* keys_in, Key* keys_out, std::int64_t n,
                              int begin_bit = 0, int end_bit = 8 * static_cast<int>(sizeof(Key)),
                              cudaStream_t stream = nullptr) {
    if (detail_on_cpu::asks_for_size(memory, bytes)) return cudaSuccess;
    cuda_on_cpu::give_work(stream, [=] {
      const cuda_on_cpu::DeviceAccess access;
      detail_on_cpu::gather(keys_in, keys_out,
                            detail_on_cpu::sorted(keys_in, static_cast<std::size_t>(n), begin_bit, end_bit));
    });
    return cudaSuccess;
  }
};

struct DeviceScan {
  template <class In, class Out>
  static cudaError_t ExclusiveSum(void* memory, std::size_t& bytes, In in, Out out, std::int64_t n,
                                  cudaStream_t stream = nullptr) {
    return ExclusiveScan(memory, bytes, in, out, std::plus<>{}, std::remove_cvref_t<decltype(out[0])>{}, n, stream);
  }
  template <class In, class Out, class Operation, class Value>
  static cudaError_t ExclusiveScan(void* memory, std::size_t& bytes, In in, Out out, Operation operation, Value first,
                                   std::int64_t n, cudaStream_t stream = nullptr) {
    if (detail_on_cpu::asks_for_size(memory, bytes)) return cudaSuccess;
    cuda_on_cpu::give_work(stream, [=] {
      const cuda_on_cpu::DeviceAccess access;
      Value sum = first;
      for (std::int64_t i = 0; i < n; ++i) {
        const auto value = in[i];  // in and out may be the same array
        out[i] = sum;
        sum = operation(sum, value);
      }
    });
    return cudaSuccess;
  }
  template <class In, class Out>
  static cudaError_t InclusiveSum(void* memory, std::size_t& bytes, In in, Out out, std::int64_t n,
                                  cudaStream_t stream = nullptr) {
    if (detail_on_cpu::asks_for_size(memory, bytes)) return cudaSuccess;
    cuda_on_cpu::give_work(stream, [=] {
      const cuda_on_cpu::DeviceAccess access;
      std::remove_cvref_t<decltype(out[0])> sum{};
      for (std::int64_t i = 0; i < n; ++i) out[i] = sum += in[i];
    });
    return cudaSuccess;
  }
};

struct DeviceReduce {
  template <class In, class Out>
  static cudaError_t Sum(void* memory, std::size_t& bytes, In in, Out out, std::int64_t n,
                         cudaStream_t stream = nullptr) {
    if (detail_on_cpu::asks_for_size(memory, bytes)) return cudaSuccess;
    cuda_on_cpu::give_work(stream, [=] {
      const cuda_on_cpu::DeviceAccess access;
      std::remove_cvref_t<decltype(out[0])> sum{};
      for (std::int64_t i = 0; i < n; ++i) sum += in[i];
      *out = sum;
    });
    return cudaSuccess;
  }
  template <class In, class Out>
  static cudaError_t Min(void* memory, std::size_t& bytes, In in, Out out, std::int64_t n,
                         cudaStream_t stream = nullptr) {
    if (detail_on_cpu::asks_for_size(memory, bytes)) return cudaSuccess;
    cuda_on_cpu::give_work(stream, [=] {
      const cuda_on_cpu::DeviceAccess access;
      if (n > 0) *out = *std::min_element(in, in + n);
    });
    return cudaSuccess;
  }
  template <class In, class Out>
  static cudaError_t Max(void* memory, std::size_t& bytes, In in, Out out, std::int64_t n,
                         cudaStream_t stream = nullptr) {
    if (detail_on_cpu::asks_for_size(memory, bytes)) return cudaSuccess;
    cuda_on_cpu::give_work(stream, [=] {
      const cuda_on_cpu::DeviceAccess access;
      if (n > 0) *out = *std::max_element(in, in + n);
    });
    return cudaSuccess;
  }
};

struct DeviceSelect {
  template <class In, class Flags, class Out, class Count>
  static cudaError_t Flagged(void* memory, std::size_t& bytes, In in, Flags flags, Out out, Count selected,
                             std::int64_t n, cudaStream_t stream = nullptr) {
    if (detail_on_cpu::asks_for_size(memory, bytes)) return cudaSuccess;
    cuda_on_cpu::give_work(stream, [=] {
      const cuda_on_cpu::DeviceAccess access;
      std::int64_t kept = 0;
      for (std::int64_t i = 0; i < n; ++i) {
        if (flags[i]) out[kept++] = in[i];
      }
      *selected = static_cast<std::remove_cvref_t<decltype(*selected)>>(kept);
    });
    return cudaSuccess;
  }
};

}  // namespace cub
