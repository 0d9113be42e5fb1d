// SPDX-License-Identifier: Apache-2.0
/// @file Results formatted for people: rows of a table, tables for a terminal.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "trainer/evaluation/results.h"

namespace splatboost {

/// One row of the table of one or more runs.
struct ResultRow {
  enum class Verdict { kNone, kBetter, kWorse, kSame };
  std::string label;
  std::vector<std::string> values;   ///< one per run, with units
  std::string change;                ///< for two runs: "4.1× faster", "0.28×", "−0.05 dB"; else empty
  Verdict verdict = Verdict::kNone;  ///< meaning of `change`
};

/// The most important rows come first. With two runs, the second is compared with the first.
std::vector<ResultRow> result_rows(std::span<const Results> runs);

/// 42.3 s, 12 min 05 s, 3 h 07 min.
std::string human_seconds(double seconds);

/// 1 234 567 with no-break thin spaces between the thousands.
std::string human_count(std::uint64_t count);

/// The table of a comparison for a terminal.
std::string comparison_table(const Results& baseline, const Results& boosted);

/// Quality at the trained and at smaller scales: one PSNR and one SSIM column per run, under its label.
std::string scales_table(std::span<const std::string> labels, std::span<const Results> runs);

}  // namespace splatboost
