// SPDX-License-Identifier: Apache-2.0
#include "trainer/evaluation/results.h"
#include "trainer/support/process_info.h"

#include <sys/mman.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <sstream>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "trainer/evaluation/result_tables.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

Results example() {
  Results r;
  r.backbone = "vanilla";
  r.boost = true;
  r.iterations = 30000;
  r.psnr = 27.25;
  r.ssim = 0.875;
  r.lpips = 0.125;
  r.psnr_beta1 = 27.0;
  r.split = "test";
  r.primitives = 1234567;
  r.train_seconds = 725.5;
  r.fps = 12.5;
  r.peak_memory_bytes = 5'000'000'000;
  r.estimated_memory_bytes = 4'900'000'000;
  r.storage_bytes = 290'000'000;
  r.device = "cpu";
  r.machine = "a \"quoted\" processor";
  r.threads = 2;
  r.seed = std::numeric_limits<std::uint64_t>::max();
  r.version = "0.1.0";
  r.command = "splatboost train -s fern";
  r.date = "2025-11-21T11:02:33Z";
  r.source = "fern";
  r.width = 1008;
  r.height = 756;
  r.views = {{"a.jpg", 26.5, 0.75, 0.25}, {"b.jpg", 28.0, 1.0, std::nullopt}};
  r.stage_seconds = {{"loss", 1.5}, {"render", 2.25}};
  r.scales = {{1, 31.5, 0.94}, {2, 30.25, 0.95}};
  r.curve = {{100, 1.5, 0.25, 1000, std::nullopt}, {200, 3.0, 0.125, 2000, 21.5}};
  return r;
}

// The message of the InputError that reading throws; empty if it throws none.
std::string error_of(const nlohmann::json& json) {
  try {
    results_from_json(json);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(Results, SurviveJson) {
  const Results before = example();
  const Results after = results_from_json(nlohmann::json::parse(to_json(before).dump()));
  EXPECT_EQ(to_json(after), to_json(before));
  EXPECT_EQ(after.backbone, "vanilla");
  EXPECT_TRUE(after.boost);
  EXPECT_EQ(after.seed, before.seed);
  EXPECT_EQ(after.primitives, 1234567u);
  ASSERT_EQ(after.views.size(), 2u);
  EXPECT_EQ(after.views[0].lpips, 0.25);
  EXPECT_FALSE(after.views[1].lpips);
  ASSERT_EQ(after.scales.size(), 2u);
  EXPECT_EQ(after.scales[1].divisor, 2);
  EXPECT_EQ(after.scales[1].psnr, 30.25);
  EXPECT_EQ(after.scales[1].ssim, 0.95);
  ASSERT_EQ(after.curve.size(), 2u);
  EXPECT_FALSE(after.curve[0].psnr);
  EXPECT_EQ(after.curve[1].psnr, 21.5);
  EXPECT_EQ(after.stage_seconds.at("render"), 2.25);
}

TEST(ScalesTable, HasARowAScaleAndColumnsARun) {
  const Results runs[] = {example(), example()};
  const std::string labels[] = {"baseline", "boosted"};
  EXPECT_EQ(scales_table(labels, runs),
            "scale         PSNR baseline   PSNR boosted   SSIM baseline   SSIM boosted\n"
            "─────────────────────────────────────────────────────────────────────────\n"
            "1 (trained)        31.50 dB       31.50 dB          0.9400         0.9400\n"
            "1/2                30.25 dB       30.25 dB          0.9500         0.9500\n");
}

TEST(Results, WithoutLpipsWriteNull) {
  Results results = example();
  results.lpips.reset();
  const nlohmann::json json = to_json(results);
  EXPECT_TRUE(json.at("lpips").is_null());
  EXPECT_FALSE(results_from_json(json).lpips);
}

TEST(Results, HoldTheKeysThatTheDesignPromises) {
  const nlohmann::json json = to_json(example());
  for (const char* key :
       {"backbone", "boost", "iterations", "psnr", "ssim", "lpips", "psnr_beta1", "primitives", "train_seconds", "fps",
        "peak_memory_bytes", "storage_bytes", "device", "threads", "seed", "version", "views", "stage_seconds"}) {
    ASSERT_TRUE(json.contains(key)) << key;
    nlohmann::json without = json;
    without.erase(key);
    EXPECT_EQ(error_of(without), "results: \"" + std::string(key) + "\" is missing.");
  }
}

TEST(Results, DoWithoutTheOtherKeys) {
  nlohmann::json json = to_json(example());
  for (const char* key : {"split", "machine", "command", "date", "source", "width", "height", "scales", "curve"})
    json.erase(key);
  EXPECT_EQ(error_of(json), "");
}

TEST(Results, OfAnotherTypeAreRefusedByName) {
  nlohmann::json json = to_json(example());
  json["psnr"] = "27";
  EXPECT_NE(error_of(json).find("\"psnr\" must be a number"), std::string::npos);
  json = to_json(example());
  json["primitives"] = -1;
  EXPECT_NE(error_of(json).find("\"primitives\""), std::string::npos);
  json = to_json(example());
  json["threads"] = 1e30;
  EXPECT_NE(error_of(json).find("\"threads\""), std::string::npos);
  json = to_json(example());
  json["views"][1].erase("ssim");
  EXPECT_EQ(error_of(json), "results: \"views[1].ssim\" is missing.");
  json["views"] = 3;
  EXPECT_NE(error_of(json).find("\"views\" must be an array"), std::string::npos);
  EXPECT_NE(error_of(nlohmann::json::array()).find("must be an object"), std::string::npos);
}

TEST(Results, ThatAreNotFiniteStaySo) {
  Results results = example();
  results.psnr = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(std::isnan(results_from_json(nlohmann::json::parse(to_json(results).dump())).psnr));
}

TEST(Comparison, HoldsRatiosAndDifferences) {
  const Results boosted = example();
  Results baseline = example();
  baseline.train_seconds = 4 * boosted.train_seconds;
  baseline.primitives = 2 * boosted.primitives;
  baseline.psnr = boosted.psnr + 0.25;
  baseline.fps = 0;
  const nlohmann::json json = comparison_to_json(baseline, boosted);
  EXPECT_EQ(json.at("baseline"), to_json(baseline));
  EXPECT_EQ(json.at("boosted"), to_json(boosted));
  EXPECT_EQ(json.at("ratios").at("train_seconds"), 0.25);
  EXPECT_EQ(json.at("ratios").at("speedup"), 4.0);
  EXPECT_EQ(json.at("ratios").at("primitives"), 0.5);
  EXPECT_EQ(json.at("ratios").at("storage_bytes"), 1.0);
  EXPECT_TRUE(json.at("ratios").at("fps").is_null());
  EXPECT_EQ(json.at("differences").at("psnr"), -0.25);
  EXPECT_EQ(json.at("differences").at("lpips"), 0.0);
  baseline.lpips.reset();
  EXPECT_TRUE(comparison_to_json(baseline, boosted).at("differences").at("lpips").is_null());
}

TEST(Comparison, SpeaksPlainly) {
  Results baseline = example(), boosted = example();
  baseline.train_seconds = 410;
  boosted.train_seconds = 100;
  baseline.primitives = 1000000;
  boosted.primitives = 280000;
  baseline.psnr = 27.31;
  boosted.psnr = 27.26;
  boosted.ssim = baseline.ssim + 0.01;
  boosted.lpips = *baseline.lpips + 0.002;
  baseline.fps = 20;
  boosted.fps = 10;
  const Results runs[] = {baseline, boosted};
  const auto row = [rows = result_rows(runs)](const std::string& label) {
    return *std::find_if(rows.begin(), rows.end(), [&](const ResultRow& r) { return r.label == label; });
  };
  using Verdict = ResultRow::Verdict;
  EXPECT_EQ(row("Training time").values, (std::vector<std::string>{"6 min 50 s", "1 min 40 s"}));
  EXPECT_EQ(row("Training time").change, "4.1× faster");
  EXPECT_EQ(row("Training time").verdict, Verdict::kBetter);
  EXPECT_EQ(row("Primitives").change, "0.28×");
  EXPECT_EQ(row("Primitives").verdict, Verdict::kBetter);
  EXPECT_EQ(row("PSNR").change, "−0.05 dB");
  EXPECT_EQ(row("PSNR").verdict, Verdict::kWorse);
  EXPECT_EQ(row("SSIM").change, "+0.0100");
  EXPECT_EQ(row("SSIM").verdict, Verdict::kBetter);
  EXPECT_EQ(row("LPIPS").change, "+0.0020");
  EXPECT_EQ(row("LPIPS").verdict, Verdict::kWorse);
  EXPECT_EQ(row("Rendering").change, "2.0× slower");
  EXPECT_EQ(row("Model size").change, "1.0×");
  EXPECT_EQ(row("Model size").verdict, Verdict::kSame);
}

TEST(Comparison, TellsTheTimeToTheSameQuality) {
  const std::vector<CurvePoint> rising = {{100, 10, 0.2, 1, 18.0}, {200, 20, 0.1, 2, {}}, {300, 30, 0.1, 2, 22.0}};
  EXPECT_EQ(seconds_to_psnr(rising, 17), 10);
  EXPECT_EQ(seconds_to_psnr(rising, 18), 10);
  EXPECT_EQ(seconds_to_psnr(rising, 21), 25);  // interpolated linearly between points that have a PSNR
  EXPECT_EQ(seconds_to_psnr(rising, 22), 30);
  EXPECT_EQ(seconds_to_psnr(rising, 22.1), std::nullopt);
  EXPECT_EQ(seconds_to_psnr({}, 1), std::nullopt);

  Results baseline = example(), boosted = example();
  const auto row = [&] {
    const Results runs[] = {baseline, boosted};
    for (const ResultRow& each : result_rows(runs)) {
      if (each.label == "Time to the baseline's PSNR") return each;
    }
    return ResultRow{};
  };
  baseline.curve = {{100, 40, 0.2, 1, 18.0}, {200, 80, 0.1, 2, 21.0}};
  boosted.curve = rising;
  EXPECT_EQ(row().values, (std::vector<std::string>{"1 min 20 s", "25.0 s"}));
  EXPECT_EQ(row().change, "3.2× faster");
  boosted.curve.pop_back();
  EXPECT_EQ(row().values, (std::vector<std::string>{"1 min 20 s", "not reached"}));
  EXPECT_EQ(row().change, "");
  baseline.curve.back().psnr.reset();
  EXPECT_EQ(row().label, "");
}

TEST(Comparison, HandlesWhatIsMissing) {
  Results baseline, boosted;
  boosted.psnr = std::numeric_limits<double>::infinity();
  const Results runs[] = {baseline, boosted};
  for (const ResultRow& row : result_rows(runs)) {
    for (const std::string& text : row.values) EXPECT_EQ(text.find("inf"), std::string::npos) << row.label;
    EXPECT_EQ(row.change.find("nan"), std::string::npos) << row.label;
    EXPECT_EQ(row.change.find("inf"), std::string::npos) << row.label;
  }
  EXPECT_FALSE(comparison_table(baseline, boosted).empty());
}

TEST(Comparison, TableIsAligned) {
  Results baseline = example();
  baseline.train_seconds = 9000;
  std::istringstream table(comparison_table(baseline, example()));
  std::vector<std::size_t> widths;
  for (std::string line; std::getline(table, line);) {
    widths.push_back(static_cast<std::size_t>(std::count_if(
        line.begin(), line.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; })));
  }
  ASSERT_EQ(widths.size(), 12u);
  EXPECT_EQ(std::count(widths.begin(), widths.end(), widths[0]), 12);
}

TEST(Words, ForTimesAndCounts) {
  EXPECT_EQ(human_seconds(0.125), "0.12 s");
  EXPECT_EQ(human_seconds(42.34), "42.3 s");
  EXPECT_EQ(human_seconds(59.96), "1 min 00 s");
  EXPECT_EQ(human_seconds(725), "12 min 05 s");
  EXPECT_EQ(human_seconds(3599.6), "1 h 00 min");
  EXPECT_EQ(human_seconds(3 * 3600 + 7 * 60), "3 h 07 min");
  EXPECT_EQ(human_count(0), "0");
  EXPECT_EQ(human_count(999), "999");
  EXPECT_EQ(human_count(1234567), "1\u202F234\u202F567");
}

TEST(Machine, TellsItsNameAndMemory) {
  EXPECT_FALSE(machine_name().empty());
  if (!reset_peak_memory()) GTEST_SKIP() << "this system does not let a process reset its peak";
  const std::uint64_t before = peak_memory_bytes();
  EXPECT_GT(before, 0u);
  // Mapped directly: an allocator, in particular a sanitizer's, may keep freed memory.
  constexpr std::size_t kSize = 64u << 20;
  void* block = ::mmap(nullptr, kSize, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(block, MAP_FAILED);
  std::memset(block, 1, kSize);
  EXPECT_GE(peak_memory_bytes(), before + kSize / 2);
  ::munmap(block, kSize);
  const std::uint64_t peak = peak_memory_bytes();
  ASSERT_TRUE(reset_peak_memory());
  EXPECT_LT(peak_memory_bytes(), peak - kSize / 2);
}

}  // namespace
}  // namespace splatboost
