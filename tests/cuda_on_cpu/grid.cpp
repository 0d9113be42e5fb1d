// SPDX-License-Identifier: Apache-2.0
// Runs grids: the threads of a block as fibers, and the rules by which they wait for each other.
#include <cstdarg>
#include <cstdio>
#include <exception>
#include <memory>
#include <numeric>
#include <string>

#include "cuda_runtime.h"
#include "fibers.h"
#include "grid.h"

namespace cuda_on_cpu {
namespace {

constexpr unsigned kMaxThreads = 1024;

struct Thread {
  enum class State { fresh, ready, in_warp_function, at_barrier, gone };
  State state = State::fresh;
  uint3 index{};
  int number = 0;  ///< index in its block
  Fiber* fiber = nullptr;
  // While in a warp function:
  WarpFunction function = WarpFunction::sync;
  unsigned mask = 0;
  std::uint64_t value = 0;
  int source = 0;
  // While at a barrier:
  int line = 0;
  // Result of either:
  std::uint64_t result = 0;

  int warp() const { return number / 32; }
  int lane() const { return number % 32; }
};

/// The running grid. There is at most one, because kernels do not launch kernels.
struct Grid {
  const std::function<void()>* kernel = nullptr;
  std::vector<Thread> threads;
  std::vector<int> order;  ///< order in which the block's threads run between two waits
  std::size_t started = 0;
  Thread* current = nullptr;
  std::exception_ptr failure;
  std::uint64_t first_epoch = 0;        ///< first epoch of the grid
  std::uint64_t first_block_epoch = 0;  ///< first epoch of the block
  std::uint64_t block_epoch = 0;        ///< current epoch: incremented per block and per barrier, over all grids
  std::vector<std::uint64_t> warp_epochs = std::vector<std::uint64_t>(kMaxThreads / 32);

  void choose(Thread& thread) {
    current = &thread;
    threadIdx = thread.index;
  }
};

Grid grid;
std::exception_ptr fault_of_work;
std::uint64_t seed = 1;
std::uint64_t launches = 0;

std::vector<std::unique_ptr<Fiber>> all_fibers;
std::vector<Fiber*> idle_fibers;

std::uint64_t next_random(std::uint64_t& state) {
  state += 0x9e3779b97f4a7c15ull;
  std::uint64_t x = state;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
  return x ^ (x >> 31);
}

template <class T>
void shuffle_order(std::vector<T>& order, std::uint64_t& state) {
  if (seed == 0) return;
  for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[next_random(state) % i]);
}

/// Body of a fiber: runs threads that have not started yet, until one waits (then another fiber takes over) or none is
/// left. A kernel that never waits needs only one fiber.
void run_threads(Fiber* self) {
  for (;;) {
    while (!grid.failure && grid.started < grid.order.size()) {
      Thread& thread = grid.threads[static_cast<std::size_t>(grid.order[grid.started++])];
      grid.choose(thread);
      thread.fiber = self;
      try {
        (*grid.kernel)();
      } catch (...) {
        grid.failure = std::current_exception();
      }
      grid.current->state = Thread::State::gone;
    }
    idle_fibers.push_back(self);
    self->give_way();
  }
}

Fiber& idle_fiber() {
  if (idle_fibers.empty()) {
    auto self = std::make_shared<Fiber*>(nullptr);
    all_fibers.push_back(std::make_unique<Fiber>([self] { run_threads(*self); }));
    *self = all_fibers.back().get();
    return *all_fibers.back();
  }
  Fiber& fiber = *idle_fibers.back();
  idle_fibers.pop_back();
  return fiber;
}

const char* name_of(WarpFunction function) {
  switch (function) {
    case WarpFunction::sync:
      return "__syncwarp";
    case WarpFunction::shuffle:
      return "a shuffle";
    case WarpFunction::ballot:
      return "__ballot_sync";
    case WarpFunction::any:
      return "__any_sync";
    case WarpFunction::all:
      return "__all_sync";
    default:
      return "a __reduce function";
  }
}

Thread* thread_at(int warp, int lane) {
  const auto number = static_cast<std::size_t>(warp * 32 + lane);
  return number < grid.threads.size() ? &grid.threads[number] : nullptr;
}

/// Completes the call that a thread waits in, if all lanes of its mask have arrived. @return whether it was completed
bool complete_warp_call(const Thread& caller) {
  const int warp = caller.warp();
  Thread* lanes[32] = {};
  for (int lane = 0; lane < 32; ++lane) {
    if ((caller.mask >> lane & 1u) == 0) continue;
    Thread* const other = thread_at(warp, lane);
    if (other == nullptr || other->state != Thread::State::in_warp_function || other->mask != caller.mask ||
        other->function != caller.function) {
      return false;
    }
    lanes[lane] = other;
  }
  const auto fold = [&](std::uint64_t start, const auto& combine) {
    for (const Thread* lane : lanes) {
      if (lane != nullptr) start = combine(start, lane->value);
    }
    return start;
  };
  std::uint64_t shared = 0;
  switch (caller.function) {
    case WarpFunction::sync:
    case WarpFunction::shuffle:
      break;
    case WarpFunction::ballot:
      for (int lane = 0; lane < 32; ++lane) {
        if (lanes[lane] != nullptr && lanes[lane]->value != 0) shared |= std::uint64_t{1} << lane;
      }
      break;
    case WarpFunction::any:
      shared = fold(0, [](auto a, auto b) { return a | b; });
      break;
    case WarpFunction::all:
      shared = fold(1, [](auto a, auto b) { return a & b; });
      break;
    case WarpFunction::add:
      shared = fold(0, [](auto a, auto b) { return (a + b) & 0xffffffffu; });
      break;
    case WarpFunction::min:
      shared = fold(0xffffffffu, [](auto a, auto b) { return std::min(a, b); });
      break;
    case WarpFunction::max:
      shared = fold(0, [](auto a, auto b) { return std::max(a, b); });
      break;
    case WarpFunction::bit_and:
      shared = fold(0xffffffffu, [](auto a, auto b) { return a & b; });
      break;
    case WarpFunction::bit_or:
      shared = fold(0, [](auto a, auto b) { return a | b; });
      break;
  }
  for (Thread* lane : lanes) {
    if (lane == nullptr) continue;
    if (lane->function == WarpFunction::shuffle) {
      const Thread* const from = lane->source >= 0 && lane->source < 32 ? lanes[lane->source] : nullptr;
      if (from == nullptr) {
        grid.current = lane;
        fault("a shuffle reads lane %d, which the mask %08x leaves out", lane->source, lane->mask);
      }
      lane->result = from->value;
    } else {
      lane->result = shared;
    }
  }
  // Of the warp functions only __syncwarp orders memory accesses of the lanes.
  const bool whole = caller.mask == 0xffffffffu || static_cast<std::size_t>(std::popcount(caller.mask)) ==
                                                       grid.threads.size() - static_cast<std::size_t>(32 * warp);
  if (caller.function == WarpFunction::sync && whole) ++grid.warp_epochs[static_cast<std::size_t>(warp)];
  for (Thread* lane : lanes) {
    if (lane != nullptr) lane->state = Thread::State::ready;
  }
  return true;
}

/// Makes threads ready whose warp function is complete, else all threads if they are at one barrier, else faults.
void complete_waits() {
  bool any = false;
  for (Thread& thread : grid.threads) {
    if (thread.state == Thread::State::in_warp_function) any |= complete_warp_call(thread);
  }
  if (any) return;
  for (Thread& thread : grid.threads) {
    if (thread.state != Thread::State::in_warp_function) continue;
    for (int lane = 0; lane < 32; ++lane) {
      if ((thread.mask >> lane & 1u) == 0) continue;
      const Thread* const other = thread_at(thread.warp(), lane);
      grid.current = &thread;
      const char* const what = name_of(thread.function);
      if (other == nullptr) fault("%s with mask %08x: the block has no lane %d", what, thread.mask, lane);
      if (other->state == Thread::State::gone) {
        fault("%s with mask %08x: lane %d has left the kernel", what, thread.mask, lane);
      }
      if (other->state == Thread::State::at_barrier) {
        fault("%s with mask %08x: lane %d waits at __syncthreads, line %d", what, thread.mask, lane, other->line);
      }
      if (other->mask != thread.mask || other->function != thread.function) {
        fault("%s with mask %08x: lane %d calls %s with mask %08x", what, thread.mask, lane, name_of(other->function),
              other->mask);
      }
    }
  }
  const Thread* first = nullptr;
  std::uint64_t sum = 0;
  for (Thread& thread : grid.threads) {
    if (thread.state != Thread::State::at_barrier) continue;
    if (first == nullptr) first = &thread;
    grid.current = &thread;
    if (thread.line != first->line) {
      fault("__syncthreads of line %d, while thread %d waits at that of line %d", thread.line, first->number,
            first->line);
    }
    sum += thread.value;
  }
  for (Thread& thread : grid.threads) {
    if (thread.state == Thread::State::at_barrier) {
      thread.state = Thread::State::ready;
      thread.result = sum;
      continue;
    }
    grid.current = &thread;
    fault("left the kernel while other threads wait at __syncthreads, line %d", first->line);
  }
  ++grid.block_epoch;
}

void run_block() {
  grid.started = 0;
  grid.first_block_epoch = ++grid.block_epoch;
  while (!grid.failure && grid.started < grid.order.size()) idle_fiber().resume();
  for (;;) {
    if (grid.failure) std::rethrow_exception(grid.failure);
    bool waits = false;
    for (const Thread& thread : grid.threads) waits |= thread.state != Thread::State::gone;
    if (!waits) return;
    complete_waits();
    for (const int number : grid.order) {
      Thread& thread = grid.threads[static_cast<std::size_t>(number)];
      if (thread.state != Thread::State::ready || grid.failure) continue;
      grid.choose(thread);
      thread.fiber->resume();
    }
  }
}

std::uint64_t wait(Thread::State state) {
  Thread& thread = *grid.current;
  thread.state = state;
  thread.fiber->give_way();
  return thread.result;
}

/// Block and thread indices of the running thread, for messages.
std::string place() {
  const uint3 at = grid.current->index;
  char text[160];
  std::snprintf(text, sizeof text, "block (%u, %u, %u), thread (%u, %u, %u): ", blockIdx.x, blockIdx.y, blockIdx.z,
                at.x, at.y, at.z);
  return text;
}

uint3 unravel(unsigned index, dim3 size) { return {index % size.x, index / size.x % size.y, index / size.x / size.y}; }

}  // namespace

void permute(std::uint64_t new_seed) {
  seed = new_seed;
  launches = 0;
}

int lane() { return grid.current->lane(); }

std::uint64_t warp_call(WarpFunction function, unsigned mask, std::uint64_t value, int source) {
  Thread& thread = *grid.current;
  if ((mask >> thread.lane() & 1u) == 0) {
    fault("%s with mask %08x, which leaves out the calling lane %d", name_of(function), mask, thread.lane());
  }
  thread.function = function;
  thread.mask = mask;
  thread.value = value;
  thread.source = source;
  return wait(Thread::State::in_warp_function);
}

int block_barrier(int line, int value) {
  grid.current->line = line;
  grid.current->value = static_cast<std::uint64_t>(value);
  return static_cast<int>(wait(Thread::State::at_barrier));
}

void fault(const char* format, ...) {
  char text[256];
  std::va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  throw Fault(place() + text);
}

bool is_in_kernel() { return grid.current != nullptr; }

Moment moment() {
  const Thread& thread = *grid.current;
  return {grid.first_epoch, grid.first_block_epoch, grid.block_epoch,
          grid.warp_epochs[static_cast<std::size_t>(thread.warp())], thread.number};
}

void end_with_fault(const std::string& what) {
  if (grid.current == nullptr) {
    if (!fault_of_work) fault_of_work = std::make_exception_ptr(Fault(what));
    return;
  }
  grid.failure = std::make_exception_ptr(Fault(place() + what));
  grid.current->fiber->give_way();
}

void throw_fault_of_work() {
  if (fault_of_work) std::rethrow_exception(std::exchange(fault_of_work, nullptr));
}

SharedAccesses::Cell& SharedAccesses::cell(int i) {
  if (i < 0 || static_cast<std::size_t>(i) >= cells_.size()) {
    fault("index %d of a shared array of %zu elements", i, cells_.size());
  }
  return cells_[static_cast<std::size_t>(i)];
}

void SharedAccesses::check_order(const Access& write, const char* what, int i) const {
  const Thread& thread = *grid.current;
  if (write.block_epoch != grid.block_epoch || write.thread == thread.number) return;
  if (write.thread / 32 == thread.warp() &&
      write.warp_epoch < grid.warp_epochs[static_cast<std::size_t>(thread.warp())]) {
    return;
  }
  fault("%s element %d of a shared array that thread %d wrote, with no barrier in between", what, i, write.thread);
}

void SharedAccesses::read(int i) {
  Cell& at = cell(i);
  const Thread& thread = *grid.current;
  if (at.write.block_epoch < grid.first_block_epoch) {
    fault("reads element %d of a shared array, which no thread of the block wrote", i);
  }
  check_order(at.write, "reads", i);
  const std::uint64_t warp_epoch = grid.warp_epochs[static_cast<std::size_t>(thread.warp())];
  Access& seen = at.reads[thread.warp()];
  const bool another = seen.block_epoch == grid.block_epoch && seen.warp_epoch == warp_epoch && seen.thread != -1 &&
                       seen.thread != thread.number;
  seen = {grid.block_epoch, warp_epoch, another ? -2 : thread.number, false};
}

void SharedAccesses::change(int i, bool atomic) {
  Cell& at = cell(i);
  const Thread& thread = *grid.current;
  const std::uint64_t warp_epoch = grid.warp_epochs[static_cast<std::size_t>(thread.warp())];
  if (atomic && at.write.block_epoch < grid.first_block_epoch) {
    fault("adds to element %d of a shared array, which no thread of the block wrote", i);
  }
  if (!(atomic && at.write.atomic)) check_order(at.write, "writes", i);
  for (int warp = 0; warp < kWarps; ++warp) {
    const Access& read = at.reads[warp];
    if (read.block_epoch != grid.block_epoch || read.thread == thread.number) continue;
    if (warp == thread.warp() && read.warp_epoch < warp_epoch) continue;
    fault("writes element %d of a shared array that a thread of warp %d read, with no barrier in between", i, warp);
  }
  at.write = {grid.block_epoch, warp_epoch, thread.number, atomic};
}

bool is_valid_shape(dim3 blocks, dim3 threads) {
  const unsigned size = threads.x * threads.y * threads.z;
  return size > 0 && size <= kMaxThreads && blocks.x * blocks.y * blocks.z > 0 && blocks.y <= 65535 &&
         blocks.z <= 65535;
}

void run(dim3 blocks, dim3 threads, const std::function<void()>& kernel) {
  const unsigned size = threads.x * threads.y * threads.z;
  const DeviceAccess access;
  std::uint64_t random = seed + ++launches;
  std::vector<unsigned> block_order(blocks.x * blocks.y * blocks.z);
  std::iota(block_order.begin(), block_order.end(), 0u);
  shuffle_order(block_order, random);
  grid.kernel = &kernel;
  blockDim = threads;
  gridDim = blocks;
  grid.failure = nullptr;
  grid.first_epoch = grid.block_epoch + 1;
  grid.threads.assign(size, Thread{});
  grid.order.resize(size);
  std::iota(grid.order.begin(), grid.order.end(), 0);
  try {
    for (const unsigned block : block_order) {
      for (unsigned number = 0; number < size; ++number) {
        Thread& thread = grid.threads[number];
        thread.state = Thread::State::fresh;
        thread.number = static_cast<int>(number);
        thread.index = unravel(number, threads);
      }
      blockIdx = unravel(block, blocks);
      shuffle_order(grid.order, random);
      run_block();
    }
  } catch (...) {
    // Threads that still wait are never resumed, so discard their stacks.
    idle_fibers.clear();
    all_fibers.clear();
    grid.current = nullptr;
    throw;
  }
  grid.current = nullptr;
}

}  // namespace cuda_on_cpu
