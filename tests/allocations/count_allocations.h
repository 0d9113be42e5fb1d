// SPDX-License-Identifier: Apache-2.0
/// @file Counts every allocation of the process: a program that has count_allocations.cpp linked in gets its own malloc
/// and operator new, which count and pass on.
#pragma once

#include <cstddef>

namespace splatboost::test {

/// Whether this build can count: sanitizers bring a malloc of their own, and other systems than glibc's name theirs
/// differently.
bool can_count_allocations();

/// Counts allocations of all threads while it lives, whoever asks for them: malloc, calloc, realloc, aligned forms,
/// operator new, and mmap, by which pools other than malloc's grow. One at a time.
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
