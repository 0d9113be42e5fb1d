// SPDX-License-Identifier: Apache-2.0
/// @file An array in the memory of a CUDA device.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "splatboost/cuda_stream.h"

namespace splatboost {

/// Owns an array of trivial values. It grows geometrically and never shrinks, so that a loop of steady sizes allocates
/// nothing. All its operations are queued on its stream, which must outlive it.
template <class T>
class DeviceArray {
  static_assert(std::is_trivially_copyable_v<T> && std::is_trivially_destructible_v<T>);

 public:
  explicit DeviceArray(CudaStream& stream) : stream_(&stream) {}
  DeviceArray(CudaStream& stream, std::span<const T> host) : stream_(&stream) { upload(host); }
  ~DeviceArray() { stream_->release(data_); }
  DeviceArray(DeviceArray&& other) noexcept
      : stream_(other.stream_),
        data_(std::exchange(other.data_, nullptr)),
        size_(std::exchange(other.size_, 0)),
        capacity_(std::exchange(other.capacity_, 0)) {}
  DeviceArray& operator=(DeviceArray&& other) noexcept {
    std::swap(stream_, other.stream_);
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    std::swap(capacity_, other.capacity_);
    return *this;
  }

  std::size_t size() const { return size_; }
  std::size_t capacity() const { return capacity_; }
  bool empty() const { return size_ == 0; }
  CudaStream& stream() const { return *stream_; }
  T* data() { return data_; }
  const T* data() const { return data_; }
  std::span<T> span() { return {data_, size_}; }
  std::span<const T> span() const { return {data_, size_}; }

  /// Sets the size to n; the values are undefined.
  void ensure(std::size_t n) {
    if (n > capacity_) {
      const std::size_t wanted = grown(n);
      stream_->release(std::exchange(data_, nullptr));  // first, so that the device never holds both
      capacity_ = size_ = 0;
      data_ = static_cast<T*>(stream_->allocate(wanted * sizeof(T)));
      capacity_ = wanted;
    }
    size_ = n;
  }

  /// Sets the size to n and keeps the existing values; new ones are undefined.
  void resize(std::size_t n) {
    if (n > capacity_) {
      DeviceArray larger(*stream_);
      larger.ensure(grown(n));
      stream_->copy_on_device(larger.data_, data_, size_ * sizeof(T));
      *this = std::move(larger);
    }
    size_ = n;
  }

  void fill_zero() { stream_->fill_zero(data_, size_ * sizeof(T)); }

  /// Becomes a copy of host memory, which may change as soon as this returns; pinned memory only when the stream's work
  /// is done.
  void upload(std::span<const T> host) {
    ensure(host.size());
    stream_->copy_to_device(data_, host.data(), host.size_bytes());
  }

  /// Waits for the device. @param host of the array's size
  void download(std::span<T> host) const { stream_->copy_to_host(host.data(), data_, host.size_bytes()); }

  /// Waits for the device.
  std::vector<T> to_host() const {
    std::vector<T> host(size_);
    download(host);
    return host;
  }

 private:
  std::size_t grown(std::size_t n) const { return std::max(n, capacity_ + capacity_ / 2); }

  CudaStream* stream_;
  T* data_ = nullptr;
  std::size_t size_ = 0;
  std::size_t capacity_ = 0;
};

}  // namespace splatboost
