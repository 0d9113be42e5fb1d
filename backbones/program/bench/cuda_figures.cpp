// SPDX-License-Identifier: Apache-2.0
#include "program/bench/cuda_figures.h"

#include "program/bench/bench_figures.h"
#include "program/bench/cuda_bench.h"
#include "program/bench/cuda_work.h"

namespace splatboost::program {

void add_cuda_figures(std::span<const BenchSize> sizes, int repeats, CudaStream& stream, const Threads& threads,
                      nlohmann::json& document, const CudaProbe& probe) {
  const CudaDeviceFacts facts = cuda_device_facts(stream);
  document["device"] = facts.name;
  document["compute_capability"] = facts.compute_capability;
  document["memory_bytes"] = facts.memory_bytes;
  document["cuda_driver"] = facts.driver;
  document["cuda_runtime"] = facts.runtime;
  const MachineLimits limits = measure_limits(stream, probe);
  document["limits"] = limits_json(limits);
  for (const BenchSize& size : sizes) {
    const BenchScene bench = make_bench_scene(size);
    const nlohmann::json milliseconds = medians_json(measure_cuda_stages(bench, stream, kBenchWarmUp, repeats));
    const BlendWork work = count_blend_work(bench, kInstructionPixels, threads);
    const std::uint64_t warps = count_blend_work(bench, kWarpPixels, threads).cells;
    nlohmann::json scene = scene_json(size, work, milliseconds);
    scene["work"] = {{"visible", work.visible},
                     {"entries", work.entries},
                     {"instructions", work.cells},
                     {"warps", warps},
                     {"pairs", work.pairs}};
    for (const auto& [stage, effort] : cuda_efforts(work, warps, bench.scene.train[0].camera, size.splats)) {
      scene["efforts"][stage] = effort_json(effort, milliseconds.at(stage).get<double>(), limits);
    }
    document["scenes"].push_back(scene);
  }
}

}  // namespace splatboost::program
