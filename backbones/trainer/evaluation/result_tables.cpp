// SPDX-License-Identifier: Apache-2.0
#include "trainer/evaluation/result_tables.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

namespace splatboost {
namespace {

std::string format(const char* pattern, double value) {
  char text[64];
  std::snprintf(text, sizeof text, pattern, value);
  return text;
}

constexpr const char* kMissing = "–";

std::string human_bytes(std::uint64_t bytes) {
  static const char* const kUnits[] = {"B", "kB", "MB", "GB", "TB"};
  double value = static_cast<double>(bytes);
  int unit = 0;
  while (value >= 999.5 && unit < 4) {
    value /= 1000;
    ++unit;
  }
  return format(unit == 0 || value >= 99.95 ? "%.0f" : value >= 9.995 ? "%.1f" : "%.2f", value) + " " + kUnits[unit];
}

std::string human_number(const std::optional<double>& value, int digits, const std::string& unit = "") {
  if (!value || !std::isfinite(*value)) return kMissing;
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", digits, *value);
  return text + unit;
}

// "4.1", "0.28", "0.041", "12", "123": two significant digits, or a whole number from 10 on.
std::string human_ratio(double ratio) {
  if (ratio >= 9.95) return format("%.0f", ratio);
  if (ratio >= 0.995) return format("%.1f", ratio);
  if (ratio >= 0.0995) return format("%.2f", ratio);
  return format("%.2g", ratio);
}

using Verdict = ResultRow::Verdict;

// Whether an increase of a value is good or bad.
enum class More { kGood, kBad };

struct Change {
  std::string text;
  Verdict verdict = Verdict::kNone;
};

Verdict judge(double change, double threshold, More more) {
  if (std::abs(change) < threshold) return Verdict::kSame;
  return (change > 0) == (more == More::kGood) ? Verdict::kBetter : Verdict::kWorse;
}

// The change of a duration or a rate in words; `factor` is how many times faster the second is.
Change speed_change(double factor) {
  if (!std::isfinite(factor) || factor <= 0) return {};
  if (std::abs(factor - 1) < 0.05) return {"equally fast", Verdict::kSame};
  if (factor > 1) return {human_ratio(factor) + "× faster", Verdict::kBetter};
  return {human_ratio(1 / factor) + "× slower", Verdict::kWorse};
}

// The change of an amount for which less is better.
Change amount_change(double first, double second) {
  if (!(first > 0) || !std::isfinite(second)) return {};
  const double ratio = second / first;
  return {human_ratio(ratio) + "×", judge(ratio - 1, 0.005, More::kBad)};
}

// The difference with `digits` decimals; one that rounds to zero counts as no change.
Change difference(const std::optional<double>& first, const std::optional<double>& second, int digits,
                  const std::string& unit, More more) {
  if (!first || !second || !std::isfinite(*first) || !std::isfinite(*second)) return {};
  const double change = *second - *first;
  const double threshold = 0.5 * std::pow(10.0, -digits);
  const std::string sign = std::abs(change) < threshold ? "±" : change > 0 ? "+" : "−";
  return {sign + human_number(std::abs(change), digits, unit), judge(change, threshold, more)};
}

// Columns a terminal needs for UTF-8 text of single-width characters.
std::size_t display_width(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

// Aligns the first column left and the others right, with a rule under the head.
std::string text_table(const std::vector<std::vector<std::string>>& lines) {
  std::vector<std::size_t> widths(lines[0].size());
  for (const auto& line : lines) {
    for (std::size_t c = 0; c < widths.size(); ++c) widths[c] = std::max(widths[c], display_width(line[c]));
  }
  std::string table;
  for (std::size_t l = 0; l < lines.size(); ++l) {
    std::string text;
    for (std::size_t c = 0; c < widths.size(); ++c) {
      const std::string padding(widths[c] - display_width(lines[l][c]), ' ');
      text += c == 0 ? lines[l][c] + padding : "   " + padding + lines[l][c];
    }
    table += text + "\n";
    if (l == 0) {
      for (std::size_t i = 0; i < display_width(text); ++i) table += "─";
      table += "\n";
    }
  }
  return table;
}

}  // namespace

std::string human_seconds(double seconds) {
  if (!std::isfinite(seconds) || seconds < 0) return kMissing;
  if (seconds < 9.995) return format("%.2f s", seconds);
  if (seconds < 59.95) return format("%.1f s", seconds);
  const auto whole = static_cast<long long>(std::llround(seconds));
  char text[64];
  if (whole < 3600) {
    std::snprintf(text, sizeof text, "%lld min %02lld s", whole / 60, whole % 60);
  } else {
    const long long minutes = (whole + 30) / 60;
    std::snprintf(text, sizeof text, "%lld h %02lld min", minutes / 60, minutes % 60);
  }
  return text;
}

std::string human_count(std::uint64_t count) {
  std::string text = std::to_string(count);
  for (std::ptrdiff_t at = static_cast<std::ptrdiff_t>(text.size()) - 3; at > 0; at -= 3) {
    text.insert(static_cast<std::size_t>(at), "\u202f");
  }
  return text;
}

std::vector<ResultRow> result_rows(std::span<const Results> runs) {
  std::vector<ResultRow> rows;
  const auto add = [&](const std::string& label, auto&& value_of, auto&& change_of) {
    ResultRow row;
    row.label = label;
    for (const Results& run : runs) row.values.push_back(value_of(run));
    if (runs.size() == 2) {
      const Change change = change_of(runs[0], runs[1]);
      row.change = change.text;
      row.verdict = change.verdict;
    }
    rows.push_back(std::move(row));
  };
  const auto quality = [&](const std::string& label, auto&& value, int digits, const std::string& unit, More more) {
    add(
        label, [&](const Results& r) { return human_number(value(r), digits, unit); },
        [&](const Results& a, const Results& b) { return difference(value(a), value(b), digits, unit, more); });
  };
  const auto amount = [&](const std::string& label, auto&& value, auto&& words) {
    add(
        label, [&](const Results& r) { return value(r) ? words(value(r)) : kMissing; },
        [&](const Results& a, const Results& b) {
          return amount_change(static_cast<double>(value(a)), static_cast<double>(value(b)));
        });
  };
  using Optional = std::optional<double>;

  add(
      "Training time", [](const Results& r) { return human_seconds(r.train_seconds); },
      [](const Results& a, const Results& b) { return speed_change(a.train_seconds / b.train_seconds); });
  // Runs that end at different quality are also compared by the time to reach the same quality.
  if (runs.size() == 2 && !runs[0].curve.empty() && runs[0].curve.back().psnr) {
    const double target = *runs[0].curve.back().psnr;
    const auto reached = [&](const Results& r) { return seconds_to_psnr(r.curve, target); };
    add(
        "Time to the baseline's PSNR",
        [&](const Results& r) { return reached(r) ? human_seconds(*reached(r)) : "not reached"; },
        [&](const Results& a, const Results& b) {
          return reached(a) && reached(b) ? speed_change(*reached(a) / *reached(b)) : Change{};
        });
  }
  quality(
      "PSNR", [](const Results& r) -> Optional { return r.psnr; }, 2, " dB", More::kGood);
  quality(
      "PSNR at β\u00a0=\u00a01", [](const Results& r) -> Optional { return r.psnr_beta1; }, 2, " dB", More::kGood);
  quality(
      "SSIM", [](const Results& r) -> Optional { return r.ssim; }, 4, "", More::kGood);
  quality(
      "LPIPS", [](const Results& r) { return r.lpips; }, 4, "", More::kBad);
  amount(
      "Primitives", [](const Results& r) { return static_cast<std::uint64_t>(r.primitives); }, human_count);
  add(
      "Rendering",
      [](const Results& r) {
        return human_number(r.fps, r.fps < 10 ? 2 : r.fps < 100 ? 1 : 0, " fps");
      },
      [](const Results& a, const Results& b) { return speed_change(b.fps / a.fps); });
  amount(
      "Peak memory", [](const Results& r) { return r.peak_memory_bytes; }, human_bytes);
  amount(
      "Model size", [](const Results& r) { return r.storage_bytes; }, human_bytes);
  return rows;
}

std::string comparison_table(const Results& baseline, const Results& boosted) {
  const Results runs[] = {baseline, boosted};
  std::vector<std::vector<std::string>> lines = {{"", "baseline", "boosted", "change"}};
  for (const ResultRow& row : result_rows(runs)) {
    lines.push_back({row.label, row.values[0], row.values[1], row.change});
  }
  return text_table(lines);
}

std::string scales_table(std::span<const std::string> labels, std::span<const Results> runs) {
  std::vector<std::vector<std::string>> lines(1, {"scale"});
  for (const std::string& label : labels) lines[0].push_back("PSNR " + label);
  for (const std::string& label : labels) lines[0].push_back("SSIM " + label);
  for (std::size_t i = 0; i < runs[0].scales.size(); ++i) {
    const int divisor = runs[0].scales[i].divisor;
    std::vector<std::string>& line = lines.emplace_back();
    line.push_back(divisor == 1 ? "1 (trained)" : "1/" + std::to_string(divisor));
    for (const Results& run : runs) line.push_back(human_number(run.scales.at(i).psnr, 2, " dB"));
    for (const Results& run : runs) line.push_back(human_number(run.scales.at(i).ssim, 4));
  }
  return text_table(lines);
}

}  // namespace splatboost
