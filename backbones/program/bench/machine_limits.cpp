// SPDX-License-Identifier: Apache-2.0
#include "program/bench/machine_limits.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <memory>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "program/bench/machine_limits.cpp"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace splatboost::program {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// Twelve independent chains of multiply-adds: enough to hide the latency of two units.
/// @return a value that depends on all of them
float multiply_add(std::size_t rounds, float factor) {
  const hn::ScalableTag<float> d;
  const auto f = hn::Set(d, factor), g = hn::Set(d, 1 - factor);
  // Different initial values keep the compiler from merging the chains.
  auto a = hn::Iota(d, 0.0f), b = hn::Iota(d, 0.1f), c = hn::Iota(d, 0.2f), e = hn::Iota(d, 0.3f);
  auto h = hn::Iota(d, 0.4f), i = hn::Iota(d, 0.5f), j = hn::Iota(d, 0.6f), k = hn::Iota(d, 0.7f);
  auto l = hn::Iota(d, 0.8f), m = hn::Iota(d, 0.9f), n = hn::Iota(d, 1.1f), o = hn::Iota(d, 1.2f);
  for (std::size_t round = 0; round < rounds; ++round) {
    a = hn::MulAdd(a, f, g);
    b = hn::MulAdd(b, f, g);
    c = hn::MulAdd(c, f, g);
    e = hn::MulAdd(e, f, g);
    h = hn::MulAdd(h, f, g);
    i = hn::MulAdd(i, f, g);
    j = hn::MulAdd(j, f, g);
    k = hn::MulAdd(k, f, g);
    l = hn::MulAdd(l, f, g);
    m = hn::MulAdd(m, f, g);
    n = hn::MulAdd(n, f, g);
    o = hn::MulAdd(o, f, g);
  }
  const auto abce = hn::Add(hn::Add(a, b), hn::Add(c, e)), hijk = hn::Add(hn::Add(h, i), hn::Add(j, k));
  const auto lmno = hn::Add(hn::Add(l, m), hn::Add(n, o));
  return hn::GetLane(hn::SumOfLanes(d, hn::Add(hn::Add(abce, hijk), lmno)));
}

std::size_t operations_a_round() {
  const hn::ScalableTag<float> d;
  return 2 * 12 * hn::Lanes(d);
}

void triad(const float* HWY_RESTRICT b, const float* HWY_RESTRICT c, float s, std::size_t n, float* HWY_RESTRICT a) {
  for (std::size_t i = 0; i < n; ++i) a[i] = b[i] + s * c[i];
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost::program
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost::program {
namespace {

HWY_EXPORT(multiply_add);
HWY_EXPORT(operations_a_round);
HWY_EXPORT(triad);

constexpr int kRuns = 10;

/// Seconds of the fastest run.
template <class Run>
double best_of_runs(const Run& run) {
  double best = 0;
  for (int i = 0; i < kRuns; ++i) {
    const auto start = std::chrono::steady_clock::now();
    run();
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    best = i == 0 ? seconds : std::min(best, seconds);
  }
  return best;
}

double measure_operations(const Threads& threads) {
  constexpr std::size_t kRounds = 20000;
  const std::size_t pieces = 64 * static_cast<std::size_t>(threads.count());  // many, so that threads finish together
  std::atomic<float> sink = 0;
  const double seconds = best_of_runs([&] {
    threads.for_range(pieces, 1,
                      [&](std::size_t, std::size_t) { sink = HWY_DYNAMIC_DISPATCH(multiply_add)(kRounds, 0.999f); });
  });
  const std::size_t operations = HWY_DYNAMIC_DISPATCH(operations_a_round)() * kRounds * pieces;
  return static_cast<double>(operations) / seconds;
}

double measure_bytes(const Threads& threads) {
  constexpr std::size_t kElements = std::size_t{1} << 26;  // 256 MiB per array
  constexpr std::size_t kGrain = std::size_t{1} << 16;
  const auto array = [] { return std::make_unique_for_overwrite<float[]>(kElements); };
  const auto a = array(), b = array(), c = array();
  threads.for_range(kElements, kGrain, [&](std::size_t begin, std::size_t end) {
    std::fill(a.get() + begin, a.get() + end, 0.0f);
    std::fill(b.get() + begin, b.get() + end, 1.0f);
    std::fill(c.get() + begin, c.get() + end, 2.0f);
  });
  const double seconds = best_of_runs([&] {
    threads.for_range(kElements, kGrain, [&](std::size_t begin, std::size_t end) {
      HWY_DYNAMIC_DISPATCH(triad)(b.get() + begin, c.get() + begin, 3.0f, end - begin, a.get() + begin);
    });
  });
  return static_cast<double>(3 * sizeof(float) * kElements) / seconds;
}

}  // namespace

MachineLimits measure_limits(const Threads& threads) { return {measure_bytes(threads), measure_operations(threads)}; }

}  // namespace splatboost::program
#endif  // HWY_ONCE
