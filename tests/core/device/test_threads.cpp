// SPDX-License-Identifier: Apache-2.0
#include "splatboost/threads.h"

#include <gtest/gtest.h>
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "device/cpu_quota.h"
#include "splatboost/errors.h"

namespace splatboost::test {
namespace {

constexpr std::size_t kElements = 1000;

/// Whether a loop visits each element once.
bool visits_all(const Threads& threads) {
  std::vector<std::atomic<int>> visits(kElements);
  threads.for_range(kElements, 3, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) ++visits[i];
  });
  for (const auto& visit : visits) {
    if (visit != 1) return false;
  }
  return true;
}

TEST(Threads, ThrowTheExceptionOfTheFirstPieceThatThrows) {
  for (const int count : {1, 2, 4}) {
    Threads threads(count);
    for (int repeat = 0; repeat < 50; ++repeat) {
      std::vector<std::atomic<int>> visits(kElements);
      std::string message;
      try {
        threads.for_range(kElements, 1, [&](std::size_t i, std::size_t) {
          ++visits[i];
          if (i >= 200 && i % 10 == 7) throw std::runtime_error("piece " + std::to_string(i));
        });
      } catch (const std::runtime_error& error) {
        message = error.what();
      }
      ASSERT_EQ(message, "piece 207") << count << " threads";
      for (std::size_t i = 0; i <= 207; ++i) ASSERT_EQ(visits[i], 1) << count << " threads, piece " << i;
      for (std::size_t i = 208; i < kElements; ++i) ASSERT_LE(visits[i], 1);
    }
    EXPECT_TRUE(visits_all(threads));  // the next loop is not affected
  }
}

TEST(Threads, RunALoopWithinALoopOnTheThreadOfItsBody) {
  Threads threads(3);
  std::atomic<int> elsewhere{0};
  std::vector<std::atomic<int>> visits(100);
  threads.for_range(10, 1, [&](std::size_t outer, std::size_t) {
    const std::thread::id own = std::this_thread::get_id();
    threads.for_range(10, 1, [&](std::size_t inner, std::size_t) {
      elsewhere += std::this_thread::get_id() == own ? 0 : 1;
      ++visits[10 * outer + inner];
    });
  });
  EXPECT_EQ(elsewhere, 0);
  for (const auto& visit : visits) EXPECT_EQ(visit, 1);
}

TEST(Threads, OfASerialLoopKeepLoopsWithinItSerialToo) {
  const Threads one(1), four(4);
  std::atomic<int> elsewhere = 0;
  const auto caller = std::this_thread::get_id();
  one.for_range(8, 1, [&](std::size_t, std::size_t) {
    four.for_range(64, 1, [&](std::size_t, std::size_t) {
      if (std::this_thread::get_id() != caller) ++elsewhere;
      std::this_thread::sleep_for(std::chrono::microseconds(50));
    });
  });
  EXPECT_EQ(elsewhere, 0);
}

TEST(Threads, TakeAnyGrainAboveZero) {
  constexpr std::size_t kMost = std::numeric_limits<std::size_t>::max();
  for (const int count : {1, 3}) {
    Threads threads(count);
    for (const std::size_t grain : {std::size_t{10}, std::size_t{11}, kMost / 2, kMost}) {
      std::atomic<int> pieces{0};
      threads.for_range(10, grain, [&](std::size_t begin, std::size_t end) {
        ++pieces;
        EXPECT_TRUE(begin == 0 && end == 10) << begin << " to " << end;
      });
      EXPECT_EQ(pieces, 1) << grain;
    }
    EXPECT_THROW(threads.for_range(10, 0, [](std::size_t, std::size_t) {}), ArgumentError);
  }
}

TEST(Threads, AreAtMostAsManyAsAUserMayRequest) {
  EXPECT_EQ(Threads(kMaxThreads).count(), kMaxThreads);
  EXPECT_THROW(Threads(kMaxThreads + 1), ArgumentError);
  EXPECT_THROW(Threads(-1), ArgumentError);
}

TEST(Threads, ServeSeveralCallersAtATime) {
  Threads threads(3);
  std::atomic<int> failures{0};
  std::vector<std::thread> callers;
  for (int caller = 0; caller < 3; ++caller) {
    callers.emplace_back([&] {
      for (int repeat = 0; repeat < 200; ++repeat) failures += visits_all(threads) ? 0 : 1;
    });
  }
  for (std::thread& caller : callers) caller.join();
  EXPECT_EQ(failures, 0);
}

TEST(Threads, WorkInAProcessThatWasForked) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP() << "the thread sanitizer starts no threads in such a process";
#endif
  Threads threads(3);
  EXPECT_TRUE(visits_all(threads));  // starts worker threads, which a forked child does not have
  std::fflush(nullptr);
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    alarm(60);
    std::exit(visits_all(threads) ? 0 : 1);  // also ends the child's worker threads
  }
  int status = -1;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0);
  EXPECT_TRUE(visits_all(threads));
}

TEST(Threads, AreAsManyAsTheCpusThatTheProcessMayUse) {
  EXPECT_EQ(Threads().count(), available_cpus());
  EXPECT_GE(available_cpus(), 1);
  EXPECT_LE(available_cpus(), cpus_in_affinity_mask());
  std::thread([] {
    cpu_set_t mask, one;
    ASSERT_EQ(sched_getaffinity(0, sizeof mask, &mask), 0);
    EXPECT_EQ(cpus_in_affinity_mask(), CPU_COUNT(&mask));
    CPU_ZERO(&one);
    for (int cpu = 0; cpu < CPU_SETSIZE && CPU_COUNT(&one) == 0; ++cpu) {
      if (CPU_ISSET(cpu, &mask)) CPU_SET(cpu, &one);
    }
    ASSERT_EQ(sched_setaffinity(0, sizeof one, &one), 0);
    EXPECT_EQ(cpus_in_affinity_mask(), 1);
  }).join();
}

}  // namespace
}  // namespace splatboost::test
