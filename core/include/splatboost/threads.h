// SPDX-License-Identifier: Apache-2.0
/// @file The thread pool that every CPU operation takes.
#pragma once

#include <cstddef>
#include <type_traits>
#include <utility>

namespace splatboost {

/// A fixed number of threads (OpenMP's, persistent) that share loops. Every operation gives the same bytes for
/// any number of threads: loops are cut by a grain that does not depend on it.
class Threads {
 public:
  /// @param count threads that work at a time, the caller included; 0 means one a hardware thread.
  explicit Threads(int count = 0);

  int count() const { return count_; }

  /// Calls body(begin, end) for [0, n) cut into pieces of `grain` (the last may be shorter), and waits for all.
  /// body must not throw. Pieces run in any order, on any thread.
  template <class Body>
  void for_range(std::size_t n, std::size_t grain, Body&& body) {
    using Plain = std::remove_reference_t<Body>;
    run(n, grain, &body, [](const void* context, std::size_t begin, std::size_t end) {
      (*static_cast<Plain*>(const_cast<void*>(context)))(begin, end);
    });
  }

 private:
  using Piece = void (*)(const void* context, std::size_t begin, std::size_t end);
  void run(std::size_t n, std::size_t grain, const void* context, Piece piece);
  int count_;
};

}  // namespace splatboost
