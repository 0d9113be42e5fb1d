// SPDX-License-Identifier: Apache-2.0
// Google Benchmark of each kernel: KERNEL/SCENE/INSTRUCTION SET on one thread, on the scenes of `splatboost bench`.
// Kernels that share a public call are timed by the core's own clock (RasterSeconds).
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include <benchmark/benchmark.h>

#include "bench/workload.h"
#include "splatboost/errors.h"
#include "splatboost/instruction_set.h"

namespace splatboost::test {
namespace {

struct Set {
  const char* name;
  InstructionSet set;
};
constexpr Set kSets[] = {
    {"avx512", InstructionSet::avx512}, {"avx2", InstructionSet::avx2}, {"portable", InstructionSet::portable}};

struct Kernel {
  const char* name;
  double (*seconds)(Workload&);  ///< runs it once
};

double timed(Workload& work, void (Workload::*call)()) {
  const auto start = std::chrono::steady_clock::now();
  (work.*call)();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

constexpr Kernel kKernels[] = {
    {"project", [](Workload& w) { return w.forward(), w.seconds().project; }},
    {"tile_lists", [](Workload& w) { return w.forward(), w.seconds().tile_lists; }},
    {"blend", [](Workload& w) { return w.forward(), w.seconds().blend; }},
    {"loss", [](Workload& w) { return timed(w, &Workload::loss); }},
    {"blend_backward", [](Workload& w) { return w.backward(), w.seconds().blend_backward; }},
    {"project_backward", [](Workload& w) { return w.backward(), w.seconds().project_backward; }},
    {"optimizer", [](Workload& w) { return w.refill_gradients(), timed(w, &Workload::adam); }},
    {"error_map", [](Workload& w) { return timed(w, &Workload::flag); }},
    {"count", [](Workload& w) { return w.count(), w.seconds().count; }},
};

/// The workload of a scene and an instruction set, warmed up. Benchmarks run in the order of their registration, so
/// keeping one workload at a time is enough.
Workload& workload_of(const BenchSize& size, const Set& set) {
  static Threads threads(1);
  static std::unique_ptr<Workload> work;
  static const BenchSize* of_size = nullptr;
  static const Set* of_set = nullptr;
  if (of_size != &size) {
    work.reset();
    work = std::make_unique<Workload>(size, threads);
  }
  if (of_size != &size || of_set != &set) work->iteration();
  of_size = &size;
  of_set = &set;
  return *work;
}

void run(benchmark::State& state, const BenchSize& size, const Set& set, const Kernel& kernel) {
  try {
    use_instruction_set(set.set);
  } catch (const ArgumentError&) {
    state.SkipWithError("not on this machine");
    return;
  }
  Workload& work = workload_of(size, set);
  for (auto _ : state) state.SetIterationTime(kernel.seconds(work));
  state.SetItemsProcessed(static_cast<std::int64_t>(size.splats) * state.iterations());
}

void register_all() {
  for (const BenchSize& size : bench_sizes()) {
    for (const Set& set : kSets) {
      for (const Kernel& kernel : kKernels) {
        const std::string name = std::string(kernel.name) + "/" + size.name + "/" + set.name;
        benchmark::RegisterBenchmark(name.c_str(), [&](benchmark::State& state) { run(state, size, set, kernel); })
            ->UseManualTime()
            ->Unit(benchmark::kMillisecond);
      }
    }
  }
}

}  // namespace
}  // namespace splatboost::test

int main(int argc, char** argv) {
  splatboost::test::register_all();
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}
