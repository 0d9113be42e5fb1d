// SPDX-License-Identifier: Apache-2.0
/// @file Workspace memory: grows geometrically, is never shrunk, and is not initialised.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <new>
#include <span>
#include <type_traits>

namespace splatboost {

/// An array of trivial values, aligned to a cache line. After ensure() the content is undefined.
template <class T>
class Buffer {
  static_assert(std::is_trivially_copyable_v<T> && std::is_trivially_destructible_v<T>);

 public:
  /// Makes room for n values; allocates only if n exceeds every size so far.
  void ensure(std::size_t n) {
    if (n > capacity_) {
      const std::size_t wanted = std::max(n, capacity_ + capacity_ / 2);
      data_.reset();  // before allocating, so that both are never in memory at once
      capacity_ = 0;
      data_.reset(static_cast<T*>(::operator new(wanted * sizeof(T), kAlignment)));
      capacity_ = wanted;
    }
    size_ = n;
  }

  T* data() { return data_.get(); }
  const T* data() const { return data_.get(); }
  std::size_t size() const { return size_; }
  T& operator[](std::size_t i) { return data_.get()[i]; }
  const T& operator[](std::size_t i) const { return data_.get()[i]; }
  std::span<T> span() { return {data_.get(), size_}; }
  std::span<const T> span() const { return {data_.get(), size_}; }

 private:
  static constexpr std::align_val_t kAlignment{64};
  struct Free {
    void operator()(T* p) const { ::operator delete(p, kAlignment); }
  };
  std::unique_ptr<T, Free> data_;
  std::size_t size_ = 0;
  std::size_t capacity_ = 0;
};

}  // namespace splatboost
