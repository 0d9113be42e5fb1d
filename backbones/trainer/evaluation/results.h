// SPDX-License-Identifier: Apache-2.0
/// @file What a run measured: results.json, and the page that shows it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

namespace splatboost {

struct ViewResult {
  std::string name;
  double psnr = 0;
  double ssim = 0;
  std::optional<double> lpips;
};

/// Quality at another scale than the trained one, means over the measured views.
struct ScaleResult {
  int divisor = 1;  ///< of the trained resolution
  double psnr = 0;
  double ssim = 0;
};

/// A point of the training curves.
struct CurvePoint {
  int iteration = 0;
  double seconds = 0;  ///< training time so far, evaluation excluded
  double loss = 0;     ///< exponential mean of the training loss
  std::size_t primitives = 0;
  std::optional<double> psnr;  ///< on (a few) test views, where evaluated
};

struct Results {
  std::string backbone;
  bool boost = false;
  int iterations = 0;
  double psnr = 0;
  double ssim = 0;
  std::optional<double> lpips;
  double psnr_beta1 = 0;  ///< what a viewer without the compact box shows
  std::string split;      ///< "test" or "train": which views were measured
  std::size_t primitives = 0;
  double train_seconds = 0;  ///< wall time of the loop, evaluation and saving excluded
  double fps = 0;            ///< rendering the measured views
  std::uint64_t peak_memory_bytes = 0;
  std::uint64_t estimated_memory_bytes = 0;  ///< what the estimate before training says for the primitives there were
  std::uint64_t storage_bytes = 0;           ///< of the .ply
  std::string device;                        ///< "cpu", or the name of the GPU
  std::string machine;                       ///< processor name
  int threads = 0;
  std::uint64_t seed = 0;
  std::string version;
  std::string command;        ///< the command line
  std::string date;           ///< ISO 8601, UTC
  std::string source;         ///< name of the scene folder
  int width = 0, height = 0;  ///< of the first training view
  std::vector<ViewResult> views;
  std::vector<ScaleResult> scales;  ///< the trained one first
  std::map<std::string, double> stage_seconds;
  std::vector<CurvePoint> curve;
};

nlohmann::json to_json(const Results& results);
/// Throws InputError if a required key is missing.
Results results_from_json(const nlohmann::json& json);

/// compare.json: {"baseline", "boosted", "ratios": boosted / baseline of time ("speedup": its inverse), primitives,
/// storage, memory and fps, "differences": boosted − baseline of PSNR, SSIM, LPIPS}. Null where a value is missing or
/// the baseline is 0.
nlohmann::json comparison_to_json(const Results& baseline, const Results& boosted);

/// One line of the table of one or more runs, in words and units for people.
struct ResultRow {
  enum class Verdict { kNone, kBetter, kWorse, kSame };
  std::string label;
  std::vector<std::string> values;   ///< one a run
  std::string change;                ///< of two runs: "4.1× faster", "0.28×", "−0.05 dB"; else empty
  Verdict verdict = Verdict::kNone;  ///< what that change means
};

/// The most important first. With two runs, the second is compared with the first.
std::vector<ResultRow> result_rows(std::span<const Results> runs);

/// 42.3 s, 12 min 05 s, 3 h 07 min.
std::string human_seconds(double seconds);

/// 1 234 567 with no-break thin spaces between the thousands.
std::string human_count(std::uint64_t count);

/// The table of a comparison for a terminal.
std::string comparison_table(const Results& baseline, const Results& boosted);

/// Quality at the trained and at smaller scales, a column of PSNR and one of SSIM a run, under its label.
std::string scales_table(std::span<const std::string> labels, std::span<const Results> runs);

}  // namespace splatboost
