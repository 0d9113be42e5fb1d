// SPDX-License-Identifier: Apache-2.0
/// @file The threads that every CPU operation takes.
#pragma once

#include <cstddef>
#include <type_traits>
#include <utility>

namespace splatboost {

/// The highest number of threads that a user may ask for: far above any machine, far below where starting them fails.
inline constexpr int kMaxThreads = 4096;

/// A number of threads that share loops. Every operation gives the same bytes for any number of threads: loops are cut
/// by a grain that does not depend on it. Cheap to make and to copy: each calling thread has one set of helper threads,
/// started by its first loops, kept until it ends, and used by all Threads that it calls. Helpers block when there is
/// nothing to do, so that processes can share cores.
class Threads {
 public:
  /// @param count threads that work at a time, the caller included; 0: as many as this process may use CPUs
  /// (available_cpus()).
  explicit Threads(int count = 0);

  int count() const { return count_; }

  /// Calls body(begin, end) for [0, n) cut into pieces of `grain` (the last may be shorter), and waits for all.
  /// Pieces run in any order, on any thread. A loop within a body runs on the thread of that body alone.
  /// When pieces throw, the exception of the first of them in [0, n) is thrown to the caller after all running pieces
  /// have ended; of the pieces behind it, some have not run.
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

/// CPUs that this process may keep busy, at least 1: those that its affinity mask allows, but no more than the CPU
/// quotas of its control groups (cgroup v1 and v2), rounded up. Read once; later changes are not seen.
int available_cpus();

}  // namespace splatboost
