// SPDX-License-Identifier: Apache-2.0
// `splatboost bench --device cuda` on the emulator: every stage runs and has a measurement, and the counted work is
// plausible; the times themselves are not checked.
#include "program/bench/cuda_bench.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "program/bench/bench_tables.h"
#include "program/bench/cuda_figures.h"
#include "program/bench/cuda_limits.h"
#include "program/bench/cuda_work.h"

namespace splatboost::program {
namespace {

const BenchSize kTiny{"tiny", 150, 48, 40, 3.2};  // 3 × 3 tiles, the last row of which is half outside

const CudaProbe kTinyProbe{.copied_bytes = 1 << 16, .threads = 512, .rounds = 2};

const std::set<std::string> kWithoutEffort{"count", "scoring"};  // their effort depends on the flagged pixels

TEST(CudaBench, TimesEveryStage) {
  CudaStream stream;
  constexpr int kRepeats = 2;
  const CudaSamples samples = measure_cuda_stages(make_bench_scene(kTiny), stream, 1, kRepeats);
  std::set<std::string> stages;
  for (const auto& [stage, milliseconds] : samples) {
    stages.insert(stage);
    EXPECT_EQ(milliseconds.size(), kRepeats) << stage;
    EXPECT_GT(*std::min_element(milliseconds.begin(), milliseconds.end()), 0) << stage;
  }
  EXPECT_EQ(stages, (std::set<std::string>{"activate", "project", "tile_lists", "blend", "loss", "blend_backward",
                                           "project_backward", "optimizer", "iteration", "count", "scoring"}));
}

TEST(CudaBench, EveryStageOfAnIterationHasAnEffort) {
  const BenchScene bench = make_bench_scene(kTiny);
  Threads threads(1);
  const BlendWork work = count_blend_work(bench, kInstructionPixels, threads);
  const auto efforts = cuda_efforts(work, count_blend_work(bench, kWarpPixels, threads).cells,
                                    bench.scene.train[0].camera, kTiny.splats);
  CudaStream stream;
  for (const auto& [stage, milliseconds] : measure_cuda_stages(bench, stream, 0, 1)) {
    if (kWithoutEffort.contains(stage)) continue;
    ASSERT_TRUE(efforts.contains(stage)) << stage;
    EXPECT_GT(efforts.at(stage).operations, 0) << stage;
    EXPECT_GT(efforts.at(stage).bytes, 0) << stage;
  }
  EXPECT_EQ(efforts.at("optimizer").bytes, 59 * 32 * 150);
  EXPECT_EQ(efforts.at("blend").operations, 21.0 * 32 * static_cast<double>(work.cells));
  double sum = 0;
  for (const char* stage :
       {"activate", "project", "tile_lists", "blend", "loss", "blend_backward", "project_backward", "optimizer"}) {
    sum += efforts.at(stage).bytes;
  }
  EXPECT_EQ(efforts.at("iteration").bytes, sum);
}

TEST(CudaBench, CountsCellsThatHoldABlendedPixel) {
  const BenchScene bench = make_bench_scene(kTiny);
  Threads threads(1);
  const BlendWork of_pixels = count_blend_work(bench, {1, 1}, threads);
  EXPECT_EQ(of_pixels.cells, of_pixels.pairs);
  const BlendWork of_tiles = count_blend_work(bench, {16, 16}, threads);
  EXPECT_LE(of_tiles.cells, of_tiles.entries);  // the box may list a tile in which a splat blends no pixel
  const BlendWork of_warps = count_blend_work(bench, kWarpPixels, threads);
  const BlendWork of_instructions = count_blend_work(bench, kInstructionPixels, threads);
  EXPECT_LE(of_tiles.cells, of_warps.cells);
  EXPECT_LE(of_warps.cells, of_instructions.cells);
  EXPECT_LE(of_instructions.cells, of_pixels.cells);
  EXPECT_LE(of_pixels.pairs, 32 * of_instructions.cells);
  EXPECT_GE(2 * of_warps.cells, of_instructions.cells);
}

TEST(CudaBench, MeasuresLimitsAndNamesTheDevice) {
  CudaStream stream;
  const MachineLimits limits = measure_limits(stream, kTinyProbe);
  EXPECT_GT(limits.bytes_per_second, 0);
  EXPECT_GT(limits.operations_per_second, 0);
  const CudaDeviceFacts facts = cuda_device_facts(stream);
  EXPECT_EQ(facts.name, stream.device_name());
  EXPECT_EQ(facts.compute_capability, "8.0");
  EXPECT_EQ(facts.driver, "12.0");
  EXPECT_EQ(facts.runtime, "12.0");
  EXPECT_GT(facts.memory_bytes, 0u);
}

TEST(CudaBench, WritesAndPrintsWhatItFound) {
  CudaStream stream;
  Threads threads(1);
  nlohmann::json document = {{"repeats", 1}, {"scenes", nlohmann::json::array()}};
  add_cuda_figures({&kTiny, 1}, 1, stream, threads, document, kTinyProbe);
  EXPECT_EQ(document["device"], stream.device_name());
  EXPECT_EQ(document["cuda_runtime"], "12.0");
  const nlohmann::json& scene = document["scenes"].at(0);
  EXPECT_EQ(scene["splats"], kTiny.splats);
  EXPECT_EQ(scene["efforts"].size() + kWithoutEffort.size(), scene["milliseconds"].size());
  const nlohmann::json& effort = scene["efforts"]["blend_backward"];
  const double seconds = 1e-3 * scene["milliseconds"]["blend_backward"].get<double>();
  const double most = document["limits"]["bytes_per_second"].get<double>();
  EXPECT_DOUBLE_EQ(effort["share_of_bytes"].get<double>(), effort["bytes"].get<double>() / seconds / most);

  testing::internal::CaptureStdout();
  print_times(document, nullptr);
  print_efforts(document);
  const std::string printed = testing::internal::GetCapturedStdout();
  EXPECT_NE(printed.find(stream.device_name() + ", CUDA 12.0; medians of 1"), std::string::npos) << printed;
  EXPECT_NE(printed.find("limits of this GPU"), std::string::npos);
  EXPECT_NE(printed.find("sort and bin"), std::string::npos);
  EXPECT_EQ(printed.find("statistics"), std::string::npos);  // not a stage of the device
}

}  // namespace
}  // namespace splatboost::program
