// SPDX-License-Identifier: Apache-2.0
/// @file What runs measured in words and units for people: rows of a table, tables for a terminal.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "trainer/evaluation/results.h"

namespace splatboost {

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
