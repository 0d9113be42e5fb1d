// SPDX-License-Identifier: Apache-2.0
/// @file Asynchronous transfers of numbers from a device to the host. For .cu files.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <type_traits>

#include "device/cuda_event.h"

namespace splatboost::cuda {

/// A queue of at most `kCapacity` values: more than the iterations that a driver lets the host run ahead.
template <class T, std::size_t kCapacity = 64>
class Readbacks {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  explicit Readbacks(CudaStream& stream)
      : stream_(stream), values_(static_cast<T*>(stream.allocate_pinned(kCapacity * sizeof(T)))) {
    for (std::unique_ptr<Event>& event : arrived_) event = std::make_unique<Event>(stream, cudaEventDisableTiming);
  }
  ~Readbacks() { stream_.release_pinned(values_); }
  Readbacks(const Readbacks&) = delete;
  Readbacks& operator=(const Readbacks&) = delete;

  bool is_empty() const { return taken_ == sent_; }
  /// Whether kCapacity values are queued: call wait() or take() before send().
  bool is_full() const { return sent_ - taken_ == kCapacity; }
  /// Queues the transfer of one value. Does not wait. @param value sizeof(T) bytes in device memory
  void send(const void* value) {
    stream_.copy_to_pinned(values_ + sent_ % kCapacity, value, sizeof(T));
    arrived_[sent_++ % kCapacity]->record();
  }
  /// The oldest value not yet taken, if it has arrived.
  std::optional<T> take() {
    if (is_empty() || !arrived_[taken_ % kCapacity]->is_done()) return std::nullopt;
    return values_[taken_++ % kCapacity];
  }
  /// Waits for the oldest value not yet taken; there must be one.
  T wait() {
    arrived_[taken_ % kCapacity]->wait();
    return values_[taken_++ % kCapacity];
  }

 private:
  CudaStream& stream_;
  T* values_;  ///< pinned, [kCapacity]
  std::array<std::unique_ptr<Event>, kCapacity> arrived_;
  std::size_t sent_ = 0, taken_ = 0;
};

}  // namespace splatboost::cuda
