// SPDX-License-Identifier: Apache-2.0
/// @file An array in the memory of a Device: trainers keep their tensors in it on any device.
#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "splatboost/device.h"
#include "splatboost/device_array.h"
#include "splatboost/errors.h"

namespace splatboost {

/// Owns trivial values: a std::vector on the CPU, a DeviceArray on a GPU. It never frees memory when it shrinks, so
/// that a loop of steady sizes allocates nothing. It converts to the spans that operations of its device take.
template <class T>
class Array {
 public:
  /// An array in host memory.
  Array() = default;
  explicit Array(Device device) {
    if (device.is_cuda()) cuda_.emplace(device.stream());
  }
  Array(Device device, std::vector<T> values) : Array(device) { assign(std::move(values)); }

  bool is_cuda() const { return cuda_.has_value(); }
  std::size_t size() const { return cuda_ ? cuda_->size() : host_.size(); }
  bool empty() const { return size() == 0; }
  std::span<T> span() { return cuda_ ? cuda_->span() : std::span<T>(host_); }
  std::span<const T> span() const { return cuda_ ? cuda_->span() : std::span<const T>(host_); }
  operator std::span<T>() { return span(); }              // NOLINT: a view of this array
  operator std::span<const T>() const { return span(); }  // NOLINT

  /// Sets the size to n; the values are undefined.
  void ensure(std::size_t n) {
    if (cuda_) {
      cuda_->ensure(n);
    } else {
      host_.resize(n);
    }
  }
  /// Sets the size to n and keeps the existing values; new ones are undefined. If memory runs out, nothing changes.
  void resize(std::size_t n) {
    if (cuda_) {
      cuda_->resize(n);
    } else {
      host_.resize(n);
    }
  }
  /// Allocates memory for n values, so that resize() up to n cannot fail. Where it has to move the values, it allocates
  /// a quarter more, so that arrays that grow step by step are not moved at each. The system provides the pages of a
  /// vector's memory only when they are written.
  void reserve(std::size_t n) {
    const std::size_t now = size();
    if (!cuda_) return n > host_.capacity() ? host_.reserve(n + n / 4) : void();
    cuda_->resize(std::max(n, now));
    cuda_->resize(now);
  }
  /// Becomes n zeros.
  void assign_zeros(std::size_t n) {
    if (!cuda_) return host_.assign(n, T{});
    cuda_->ensure(n);
    cuda_->fill_zero();
  }
  /// Becomes these values; on a GPU a copy of them.
  void assign(std::vector<T> values) {
    if (cuda_) {
      cuda_->upload(values);
    } else {
      host_ = std::move(values);
    }
  }

  // Access from the host. On a GPU these wait: do not call them in the training loop.

  /// A copy of the values.
  std::vector<T> to_host() const { return cuda_ ? cuda_->to_host() : host_; }
  /// The values in host memory: on the CPU the array itself, on a GPU a copy in `copy`.
  std::span<const T> on_host(std::vector<T>& copy) const {
    if (!cuda_) return host_;
    copy.resize(size());
    cuda_->download(copy);
    return copy;
  }
  /// Calls change(span) on the values from `first` on, in host memory; on a GPU they are downloaded and uploaded again.
  template <class Change>
  void edit(std::size_t first, const Change& change) {
    if (!cuda_) return change(std::span<T>(host_).subspan(first));
    std::vector<T> values(size() - first);
    CudaStream& stream = cuda_->stream();
    stream.copy_to_host(values.data(), cuda_->data() + first, values.size() * sizeof(T));
    change(std::span<T>(values));
    stream.copy_to_device(cuda_->data() + first, values.data(), values.size() * sizeof(T));
  }

  // The underlying storage, for code that differs per device. Throws ArgumentError on the wrong device.

  std::vector<T>& host() {
    SPLATBOOST_CHECK(!cuda_, "these values are on a GPU");
    return host_;
  }
  const std::vector<T>& host() const {
    SPLATBOOST_CHECK(!cuda_, "these values are on a GPU");
    return host_;
  }
  DeviceArray<T>& cuda() {
    SPLATBOOST_CHECK(cuda_, "these values are not on a GPU");
    return *cuda_;
  }

 private:
  std::vector<T> host_;                 ///< on the CPU
  std::optional<DeviceArray<T>> cuda_;  ///< on a GPU
};

/// A copy in host memory of values on a device; on a GPU it waits.
template <class T>
std::vector<T> copy_to_host(std::span<const T> values, Device device) {
  std::vector<T> copy(values.size());
  if (device.is_cuda()) {
    device.stream().copy_to_host(copy.data(), values.data(), values.size_bytes());
  } else {
    std::copy(values.begin(), values.end(), copy.begin());
  }
  return copy;
}

}  // namespace splatboost
