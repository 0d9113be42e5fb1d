// SPDX-License-Identifier: Apache-2.0
#include "splatboost/threads.h"

#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <exception>
#include <memory>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "device/cpu_quota.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

/// How long a waiting thread spins before it blocks. Most pauses between the loops of an iteration are shorter; other
/// processes lose at most this much time on the core.
constexpr std::chrono::microseconds kAwake{200};
constexpr int kChecksAtATime = 32;  // per reading of the clock

/// Yields to the other hardware thread of the core, if there is one.
void pause() {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

/// Waits until ready(value): spins for a short time, then blocks until notified. @return the value
template <class Ready>
std::uint32_t wait_until(const std::atomic<std::uint32_t>& value, const Ready& ready) {
  using Clock = std::chrono::steady_clock;
  std::uint32_t now = value.load(std::memory_order_acquire);
  if (ready(now)) return now;
  const Clock::time_point end = Clock::now() + kAwake;
  while (Clock::now() < end) {
    for (int i = 0; i < kChecksAtATime; ++i) {
      now = value.load(std::memory_order_acquire);
      if (ready(now)) return now;
      pause();
    }
  }
  for (;;) {
    value.wait(now);
    now = value.load(std::memory_order_acquire);
    if (ready(now)) return now;
  }
}

/// A loop that threads share.
struct Loop {
  std::size_t n = 0, grain = 1, pieces = 0;
  const void* context = nullptr;
  void (*piece)(const void* context, std::size_t begin, std::size_t end) = nullptr;

  void run_piece(std::size_t i) const {
    const std::size_t begin = i * grain;
    piece(context, begin, begin + std::min(grain, n - begin));
  }
};

/// Whether this thread is running the body of a loop.
thread_local bool in_a_loop = false;

class InALoop {
 public:
  InALoop() : before_(in_a_loop) { in_a_loop = true; }
  ~InALoop() { in_a_loop = before_; }
  InALoop(const InALoop&) = delete;
  InALoop& operator=(const InALoop&) = delete;

 private:
  bool before_;
};

/// The helper threads of one calling thread. The caller never waits for a helper to start: helpers join a loop if they
/// are scheduled in time, so that a loop does not stall while another process occupies a helper's core.
class Team {
 public:
  Team() = default;
  Team(const Team&) = delete;
  Team& operator=(const Team&) = delete;
  ~Team() {
    welcome_ = kGoHome;
    welcome_.notify_all();
    for (std::thread& helper : helpers_) helper.join();
  }

  void run(const Loop& loop, std::size_t wanted) {
    const auto helpers = static_cast<std::uint32_t>(start(wanted));
    loop_ = loop;
    next_.store(0, std::memory_order_relaxed);
    finished_.store(0, std::memory_order_relaxed);
    welcome_ = helpers;
    welcome_.notify_all();
    work();
    const std::uint32_t joined = helpers - welcome_.exchange(0);
    wait_until(finished_, [&](std::uint32_t finished) { return finished == joined; });
    if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
  }

 private:
  static constexpr std::uint32_t kGoHome = ~std::uint32_t{0};

  /// Starts helpers until there are `wanted`, or until the system allows no more. @return how many may join
  std::size_t start(std::size_t wanted) {
    try {
      while (helpers_.size() < wanted) helpers_.emplace_back([this] { help(); });
    } catch (const std::system_error&) {  // the system allows no more threads: use the existing ones
    }
    return std::min(wanted, helpers_.size());
  }

  void help() {
    for (;;) {
      std::uint32_t places = wait_until(welcome_, [](std::uint32_t value) { return value != 0; });
      if (places == kGoHome) return;
      if (!welcome_.compare_exchange_strong(places, places - 1)) continue;
      work();
      finished_.fetch_add(1);
      finished_.notify_one();
    }
  }

  /// Runs pieces until none is left. Pieces start in ascending order: when one throws, all before it have started, so
  /// the first piece of the range that throws is always found.
  void work() {
    const InALoop mark;
    for (;;) {
      // Dynamic scheduling, because pieces differ in work.
      const std::size_t i = next_.fetch_add(1, std::memory_order_relaxed);
      if (i >= loop_.pieces) return;
      try {
        loop_.run_piece(i);
      } catch (...) {
        next_.store(loop_.pieces, std::memory_order_relaxed);
        const std::lock_guard lock(error_mutex_);
        if (!error_ || i < error_piece_) {
          error_ = std::current_exception();
          error_piece_ = i;
        }
      }
    }
  }

  Loop loop_;
  alignas(64) std::atomic<std::uint32_t> welcome_{0};   ///< helpers that may still join the loop
  alignas(64) std::atomic<std::uint32_t> finished_{0};  ///< helpers that joined the loop and are done
  alignas(64) std::atomic<std::size_t> next_{0};        ///< the next piece to run
  std::mutex error_mutex_;
  std::exception_ptr error_;
  std::size_t error_piece_ = 0;
  std::vector<std::thread> helpers_;
};

/// The calling thread's team. A forked child process has none of its parent's threads, so it starts a new team.
Team& own_team() {
  thread_local std::unique_ptr<Team> team;
  static const int forget_in_child = pthread_atfork(nullptr, nullptr, [] { static_cast<void>(team.release()); });
  static_cast<void>(forget_in_child);
  if (!team) team = std::make_unique<Team>();
  return *team;
}

}  // namespace

Threads::Threads(int count) : count_(count) {
  SPLATBOOST_CHECK(count >= 0 && count <= kMaxThreads,
                   "the number of threads must be from 0 to " + std::to_string(kMaxThreads));
  if (count == 0) count_ = available_cpus();
}

void Threads::run(std::size_t n, std::size_t grain, const void* context, Piece piece) const {
  SPLATBOOST_CHECK(grain > 0, "grain must be above 0");
  const Loop loop{n, grain, n / grain + (n % grain != 0 ? 1 : 0), context, piece};
  if (loop.pieces == 0) return;
  if (loop.pieces == 1) return loop.run_piece(0);  // loops within it may use the threads
  if (count_ == 1 || in_a_loop) {
    const InALoop mark;
    for (std::size_t i = 0; i < loop.pieces; ++i) loop.run_piece(i);
    return;
  }
  own_team().run(loop, std::min(static_cast<std::size_t>(count_), loop.pieces) - 1);
}

int available_cpus() {
  static const int cpus = cpus_within(cpus_in_affinity_mask(), cpu_quota("/"));
  return cpus;
}

}  // namespace splatboost
