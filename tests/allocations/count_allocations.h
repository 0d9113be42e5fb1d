// SPDX-License-Identifier: Apache-2.0
/// @file Counts every allocation of the process: a program linked with count_allocations.cpp gets its own malloc, which
/// counts and forwards to glibc's; operator new calls it.
#pragma once

#include <cstddef>

namespace splatboost::test {

/// Whether this build can count: sanitizers replace malloc themselves, and C libraries other than glibc name theirs
/// differently.
bool can_count_allocations();

/// Counts the allocations of all threads during its lifetime: malloc, calloc, realloc, aligned variants, operator new,
/// and mmap, by which memory pools other than malloc's grow. Only one may exist at a time.
class AllocationCount {
 public:
  AllocationCount();
  ~AllocationCount();
  AllocationCount(const AllocationCount&) = delete;
  AllocationCount& operator=(const AllocationCount&) = delete;

  std::size_t allocations() const;
  std::size_t bytes() const;
};

}  // namespace splatboost::test
