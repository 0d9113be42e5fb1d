// SPDX-License-Identifier: Apache-2.0
// Checks accesses to device memory. The .cu files are compiled with -fsanitize=thread, so the compiler inserts a call
// of a function with a known name at each access. These functions are defined here instead of in the thread sanitizer,
// which does not know fibers and blocks. Two unordered accesses in a grid of which at least one writes and not both are
// atomic are a fault, and so is a read of unwritten memory.
#include "accesses.h"

#include <sys/mman.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "cuda_runtime.h"
#include "grid.h"

namespace cuda_on_cpu {
namespace {

/// The last access of one kind to a byte.
struct Access {
  // Values of `thread` other than the index of a thread:
  static constexpr std::uint64_t kSeveralOfWarp = 1024;  ///< several threads of a warp: plus its index
  static constexpr std::uint64_t kSeveral = 1056;        ///< several threads of a block, between two barriers
  static constexpr std::uint64_t kSeveralBlocks = 1057;  ///< several blocks of the grid

  std::uint64_t epoch : 40 = 0;
  std::uint64_t thread : 11 = 0;
  std::uint64_t warp_epoch : 13 = 0;  ///< lowest bits

  static Access of(const Moment& now) {
    Access access;
    access.epoch = now.now & ((std::uint64_t{1} << 40) - 1);
    access.thread = static_cast<std::uint64_t>(now.thread) & 2047u;
    access.warp_epoch = now.warp_now & 8191u;
    return access;
  }
  bool is_of_grid(const Moment& now) const { return epoch >= now.grid; }
  bool is_of_warp(const Moment& now) const {
    const auto warp = static_cast<std::uint64_t>(now.thread / 32);
    return thread < kSeveralOfWarp ? thread / 32 == warp : thread == kSeveralOfWarp + warp;
  }
  /// Whether it is ordered before `now` in every order of execution.
  bool is_before(const Moment& now) const {
    if (!is_of_grid(now)) return true;
    if (epoch < now.block || thread == kSeveralBlocks) return false;
    if (epoch < now.now || thread == static_cast<std::uint64_t>(now.thread)) return true;
    return is_of_warp(now) && warp_epoch != (now.warp_now & 8191u);
  }
  /// Merges another access at `now`, for kinds whose concurrent accesses are allowed (reads, atomics).
  void join(const Moment& now) {
    Access joined = of(now);
    if (is_of_grid(now) && (epoch < now.block || thread == kSeveralBlocks)) {
      joined.thread = kSeveralBlocks;
    } else if (epoch == now.now && !is_before(now)) {
      joined.thread =
          (is_of_warp(now) ? kSeveralOfWarp + static_cast<std::uint64_t>(now.thread / 32) : kSeveral) & 2047u;
    }
    *this = joined;
  }
};

struct Cell {
  Access write, atomic, read;
};

// For each byte of device memory: its last accesses, and whether it was written.
const std::byte* begin = nullptr;
std::size_t watched = 0;
Cell* cells = nullptr;
bool* written = nullptr;

template <class T>
T* reserve(std::size_t n) {
  void* const at =
      mmap(nullptr, n * sizeof(T), PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (at != MAP_FAILED) return static_cast<T*>(at);
  std::fprintf(stderr, "the CUDA emulator found no %zu GiB of addresses: see ulimit -v and vm.overcommit_memory\n",
               n * sizeof(T) >> 30);
  std::abort();
}

/// Offset of an address in device memory; at least `watched` for addresses outside it.
std::size_t offset_of(const void* at) {
  return static_cast<std::size_t>(reinterpret_cast<std::uintptr_t>(at) - reinterpret_cast<std::uintptr_t>(begin));
}

void report(const char* what, std::size_t offset, const Access& other, const char* did, const Moment& now) {
  char address[32];
  std::snprintf(address, sizeof address, "%p", static_cast<const void*>(begin + offset));
  const bool of_another_block = other.epoch < now.block || other.thread == Access::kSeveralBlocks;
  end_with_fault(
      std::string(what) + " global memory at " + address + ", which " +
      (other.thread < Access::kSeveralOfWarp ? "thread " + std::to_string(other.thread) : "several threads") +
      (of_another_block ? " of another block " : " ") + did + ", with no barrier in between");
}

void check_written(std::size_t offset, std::size_t bytes) {
  const void* const hole = std::memchr(written + offset, 0, bytes);
  if (hole == nullptr) return;
  char text[96];
  std::snprintf(text, sizeof text, "reads global memory at %p, which nobody wrote",
                static_cast<const void*>(begin + (static_cast<const bool*>(hole) - written)));
  end_with_fault(text);
}

/// Calls note(offset, cell, now) for each byte that a thread of a kernel accesses. Other work is always ordered.
template <class Note>
void for_bytes_of_thread(std::size_t offset, std::size_t bytes, const Note& note) {
  if (!is_in_kernel()) return;
  const Moment now = moment();
  for (std::size_t byte = offset; byte < offset + bytes; ++byte) note(byte, cells[byte], now);
}

void read(const void* at, std::size_t bytes) {
  const std::size_t offset = offset_of(at);
  if (offset >= watched) return;
  check_written(offset, bytes);
  for_bytes_of_thread(offset, bytes, [](std::size_t byte, Cell& cell, const Moment& now) {
    if (!cell.write.is_before(now)) report("reads", byte, cell.write, "wrote", now);
    if (!cell.atomic.is_before(now)) report("reads", byte, cell.atomic, "changed", now);
    cell.read.join(now);
  });
}

void write(const void* at, std::size_t bytes) {
  const std::size_t offset = offset_of(at);
  if (offset >= watched) return;
  std::memset(written + offset, 1, bytes);
  for_bytes_of_thread(offset, bytes, [](std::size_t byte, Cell& cell, const Moment& now) {
    if (!cell.write.is_before(now)) report("writes", byte, cell.write, "wrote", now);
    if (!cell.atomic.is_before(now)) report("writes", byte, cell.atomic, "changed", now);
    if (!cell.read.is_before(now)) report("writes", byte, cell.read, "read", now);
    cell.write = Access::of(now);
  });
}

}  // namespace

void watch([[maybe_unused]] const std::byte* first, [[maybe_unused]] std::size_t bytes) {
#ifdef SPLATBOOST_WATCHES_ACCESSES
  begin = first;
  cells = reserve<Cell>(bytes);
  written = reserve<bool>(bytes);
  watched = bytes;
#endif
}

void forget(const void* memory, std::size_t bytes) {
  if (const std::size_t offset = offset_of(memory); offset < watched) std::memset(written + offset, 0, bytes);
}

void note_atomic(const void* at, std::size_t bytes) {
  const std::size_t offset = offset_of(at);
  if (offset >= watched) return;
  check_written(offset, bytes);
  for_bytes_of_thread(offset, bytes, [](std::size_t byte, Cell& cell, const Moment& now) {
    if (!cell.write.is_before(now)) report("writes", byte, cell.write, "wrote", now);
    if (!cell.read.is_before(now)) report("writes", byte, cell.read, "read", now);
    cell.atomic.join(now);
  });
}
void note_read(const void* memory, std::size_t bytes) {
  if (const std::size_t offset = offset_of(memory); offset < watched) check_written(offset, bytes);
}
void note_written(const void* memory, std::size_t bytes) {
  if (const std::size_t offset = offset_of(memory); offset < watched) std::memset(written + offset, 1, bytes);
}

}  // namespace cuda_on_cpu

// The functions that the compiler calls.
extern "C" {
void __tsan_init() {}
void __tsan_func_entry(void*) {}
void __tsan_func_exit() {}
void __tsan_vptr_update(void**, void*) {}
void __tsan_vptr_read(void**) {}
void __tsan_read_range(void* at, std::size_t bytes) { cuda_on_cpu::read(at, bytes); }
void __tsan_write_range(void* at, std::size_t bytes) { cuda_on_cpu::write(at, bytes); }
#define SPLATBOOST_ACCESS(bytes)                                                \
  void __tsan_read##bytes(void* at) { cuda_on_cpu::read(at, bytes); }           \
  void __tsan_write##bytes(void* at) { cuda_on_cpu::write(at, bytes); }         \
  void __tsan_unaligned_read##bytes(void* at) { cuda_on_cpu::read(at, bytes); } \
  void __tsan_unaligned_write##bytes(void* at) { cuda_on_cpu::write(at, bytes); }
SPLATBOOST_ACCESS(1)
SPLATBOOST_ACCESS(2)
SPLATBOOST_ACCESS(4)
SPLATBOOST_ACCESS(8)
SPLATBOOST_ACCESS(16)
#undef SPLATBOOST_ACCESS
// Atomics of host code, such as counters of shared pointers: the compiler replaces these by calls too.
#define SPLATBOOST_ATOMICS(bits, Int)                                                                           \
  Int __tsan_atomic##bits##_load(const volatile Int* at, int) { return __atomic_load_n(at, __ATOMIC_SEQ_CST); } \
  Int __tsan_atomic##bits##_fetch_add(volatile Int* at, Int by, int) {                                          \
    return __atomic_fetch_add(at, by, __ATOMIC_SEQ_CST);                                                        \
  }                                                                                                             \
  Int __tsan_atomic##bits##_fetch_sub(volatile Int* at, Int by, int) {                                          \
    return __atomic_fetch_sub(at, by, __ATOMIC_SEQ_CST);                                                        \
  }
SPLATBOOST_ATOMICS(32, std::int32_t)
SPLATBOOST_ATOMICS(64, std::int64_t)
#undef SPLATBOOST_ATOMICS
}
