// SPDX-License-Identifier: Apache-2.0
#include "allocations/count_allocations.h"

#include <atomic>
#include <cerrno>
#include <cstdlib>

#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#if !defined(__GLIBC__) || !defined(__LP64__) || defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SPLATBOOST_OTHER_MALLOC
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define SPLATBOOST_OTHER_MALLOC
#endif
#endif

namespace {

std::atomic<bool> counting{false};
std::atomic<std::size_t> counted{0};
std::atomic<std::size_t> counted_bytes{0};

[[maybe_unused]] void note(std::size_t size) {
  if (!counting.load(std::memory_order_relaxed)) return;
  counted.fetch_add(1, std::memory_order_relaxed);
  counted_bytes.fetch_add(size, std::memory_order_relaxed);
}

}  // namespace

#ifndef SPLATBOOST_OTHER_MALLOC
// A malloc defined by the program replaces glibc's in the whole process, shared libraries included; glibc exports its
// own under these names. libstdc++'s operator new calls malloc or aligned_alloc, so it needs no replacement.
extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* old, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);

void* malloc(std::size_t size) {
  note(size);
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  note(count * size);
  return __libc_calloc(count, size);
}
void* realloc(void* old, std::size_t size) {
  note(size);
  return __libc_realloc(old, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  note(size);
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  note(size);
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** result, std::size_t alignment, std::size_t size) {
  note(size);
  *result = __libc_memalign(alignment, size);
  return *result == nullptr ? ENOMEM : 0;
}
// Memory pools other than malloc's get their memory from the system in large blocks.
void* mmap(void* address, std::size_t size, int protection, int flags, int file, off_t offset) noexcept {
  note(size);
  return reinterpret_cast<void*>(syscall(SYS_mmap, address, size, protection, flags, file, offset));
}
}  // extern "C"
#endif

namespace splatboost::test {

bool can_count_allocations() {
#ifdef SPLATBOOST_OTHER_MALLOC
  return false;
#else
  return true;
#endif
}

AllocationCount::AllocationCount() {
  counted = 0;
  counted_bytes = 0;
  counting = true;
}
AllocationCount::~AllocationCount() { counting = false; }
std::size_t AllocationCount::allocations() const { return counted; }
std::size_t AllocationCount::bytes() const { return counted_bytes; }

}  // namespace splatboost::test
