// SPDX-License-Identifier: Apache-2.0
// After the first iterations have grown all workspaces, training allocates nothing: neither the core's calls nor a step
// of vanilla. All allocations of the process are counted, those of the thread runtime included.
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <memory>
#include <vector>

#include "allocations/count_allocations.h"
#include "bench/workload.h"
#include "vanilla/vanilla.h"

namespace splatboost::test {
namespace {

constexpr int kIterations = 30;
// A thread allocates its own data when it first has work, which may be late on a busy machine.
constexpr int kMaxRounds = 16;
const BenchSize kSize{"small", 3000, 150, 117};

/// Runs rounds of iterations (from 1) until one allocates nothing. @return allocations of the last
template <class Iteration>
std::size_t allocations_when_warm(const Iteration& iteration) {
  std::size_t allocations = 0;
  int number = 0;
  for (int round = 0; round < kMaxRounds; ++round) {
    AllocationCount count;
    for (int i = 0; i < kIterations; ++i) iteration(++number);
    allocations = count.allocations();
    if (round > 0 && allocations == 0) break;
  }
  return allocations;
}

class SteadyLoop : public testing::TestWithParam<int> {
 protected:
  void SetUp() override {
    if (!can_count_allocations()) GTEST_SKIP() << "this build brings another malloc";
  }
};

TEST_P(SteadyLoop, CounterSeesAllocationsOfAllThreads) {
  Threads threads(GetParam());
  std::atomic<std::size_t> sum = 0;  // of addresses: keeps the compiler from optimizing the allocations away
  AllocationCount count;
  threads.for_range(10, 1, [&](std::size_t, std::size_t) {
    const auto some = std::make_unique<double[]>(1000);
    const std::vector<int> more(10);
    void* raw = std::malloc(17);
    sum += reinterpret_cast<std::size_t>(some.get()) + reinterpret_cast<std::size_t>(more.data()) +
           reinterpret_cast<std::size_t>(raw);
    std::free(raw);
  });
  const std::size_t allocations = count.allocations(), bytes = count.bytes();
  EXPECT_GE(allocations, 30u);
  EXPECT_GE(bytes, 10 * (8000u + 40u + 17u));
}

TEST_P(SteadyLoop, CoreAllocatesNothing) {
  Threads threads(GetParam());
  Workload work(kSize, threads);
  EXPECT_EQ(allocations_when_warm([&](int) { work.iteration(); }), 0u);
}

TEST_P(SteadyLoop, VanillaWithoutDensificationAllocatesNothing) {
  Threads threads(GetParam());
  BenchScene bench = make_bench_scene(kSize);
  bench.scene.points.positions = bench.cloud.means;
  bench.scene.points.colors.assign(3 * kSize.splats, 128);
  VanillaConfig config;
  config.position_rate_initial = config.position_rate_final = 1e-20;  // the same tile entries in every iteration
  config.scaling_rate = config.rotation_rate = 0;
  const auto vanilla = make_vanilla({.scene = bench.scene, .threads = threads}, config);
  // Statistics are gathered from the first iteration on; densification starts after config.densify_from.
  ASSERT_LE(kMaxRounds * kIterations, config.densify_from);
  EXPECT_EQ(allocations_when_warm([&](int i) { vanilla->train_step(i, bench.scene.train[0]); }), 0u);
}

INSTANTIATE_TEST_SUITE_P(Threads, SteadyLoop, testing::Values(1, 2, 3));

}  // namespace
}  // namespace splatboost::test
