// SPDX-License-Identifier: Apache-2.0
/// @file The threads that CPU operations run on.
#pragma once

#include <cstddef>
#include <type_traits>
#include <utility>

namespace splatboost {

/// Largest number of threads that a user may request: far above the cores of any machine, far below the number at which
/// starting threads fails.
inline constexpr int kMaxThreads = 4096;

/// A number of threads for parallel loops. Results are bitwise the same for any number of threads: loops are divided by
/// a grain that does not depend on it. Cheap to create and to copy: each calling thread has one set of helper threads,
/// which its first loops start, which all its Threads objects share, and which live until it ends. Idle helpers block,
/// so that processes can share cores.
class Threads {
 public:
  /// @param count threads that work on a loop, including the caller, at most kMaxThreads; 0: available_cpus().
  ///     Throws ArgumentError outside this range
  explicit Threads(int count = 0);

  int count() const { return count_; }

  /// Calls body(begin, end) for [0, n) divided into pieces of `grain` (above 0; the last may be shorter), and waits for
  /// all.
  /// Pieces run in any order, on any thread. Within one of several pieces, a loop runs only on that piece's thread.
  /// If pieces throw, the exception of the first of them in [0, n) is rethrown after all running pieces have ended;
  /// some of the later pieces may not have run.
  template <class Body>
  void for_range(std::size_t n, std::size_t grain, Body&& body) const {
    using Plain = std::remove_reference_t<Body>;
    run(n, grain, &body, [](const void* context, std::size_t begin, std::size_t end) {
      (*static_cast<Plain*>(const_cast<void*>(context)))(begin, end);
    });
  }

 private:
  using Piece = void (*)(const void* context, std::size_t begin, std::size_t end);
  void run(std::size_t n, std::size_t grain, const void* context, Piece piece) const;
  int count_;
};

/// Number of CPUs that this process may use, at least 1: those of its affinity mask, but no more than the CPU quotas of
/// its control groups (cgroup v1 and v2), rounded up. Read once; later changes have no effect.
int available_cpus();

}  // namespace splatboost
