// SPDX-License-Identifier: Apache-2.0
#include "trainer/evaluation/results.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <sstream>
#include <stdexcept>

#include <nlohmann/json.hpp>

#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

using nlohmann::json;

json optional_number(const std::optional<double>& value) { return value ? json(*value) : json(nullptr); }

// --- reading

[[noreturn]] void fail(const std::string& key, const std::string& problem) {
  throw InputError("results: " + key + " " + problem + ".");
}

// A member of an object that is known to be one; names its place in messages.
struct Member {
  const json* value;  // null: absent
  std::string name;

  Member(const json& object, const std::string& place, const std::string& key)
      : value(object.contains(key) ? &object.at(key) : nullptr), name("\"" + place + key + "\"") {}

  const json& need() const {
    if (!value) fail(name, "is missing");
    return *value;
  }
};

// JSON has no NaN: a number that is not finite is written as null, and read back as NaN.
void read(const Member& member, double& out) {
  const json& value = member.need();
  if (!value.is_number() && !value.is_null()) fail(member.name, "must be a number");
  out = value.is_null() ? std::numeric_limits<double>::quiet_NaN() : value.get<double>();
}

void read(const Member& member, std::optional<double>& out) {
  const json& value = member.need();
  if (!value.is_number() && !value.is_null()) fail(member.name, "must be a number or null");
  out = value.is_null() ? std::nullopt : std::optional(value.get<double>());
}

void read(const Member& member, std::string& out) {
  if (!member.need().is_string()) fail(member.name, "must be a string");
  out = member.value->get<std::string>();
}

void read(const Member& member, bool& out) {
  if (!member.need().is_boolean()) fail(member.name, "must be true or false");
  out = member.value->get<bool>();
}

void read(const Member& member, std::uint64_t& out) {
  const json& value = member.need();
  if (!value.is_number_unsigned() && !(value.is_number_integer() && value.get<std::int64_t>() >= 0)) {
    fail(member.name, "must be a whole number of at least 0");
  }
  out = member.value->get<std::uint64_t>();
}

void read(const Member& member, int& out) {
  std::uint64_t number = 0;
  read(member, number);
  if (number > static_cast<std::uint64_t>(std::numeric_limits<int>::max())) fail(member.name, "is too large");
  out = static_cast<int>(number);
}

// What later versions added, or what a reader can do without.
template <typename T>
void read_optional(const Member& member, T& out) {
  if (member.value) read(member, out);
}

const json& need_object(const json& value, const std::string& name) {
  if (!value.is_object()) fail(name, "must be an object");
  return value;
}

const json& need_array(const Member& member) {
  if (!member.need().is_array()) fail(member.name, "must be an array");
  return *member.value;
}

// --- words for people

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

// "4.1", "0.28", "0.041", "12": two significant digits, three from 10 on only where they are whole.
std::string human_ratio(double ratio) {
  if (ratio >= 9.95) return format("%.0f", ratio);
  if (ratio >= 0.995) return format("%.1f", ratio);
  if (ratio >= 0.0995) return format("%.2f", ratio);
  return format("%.2g", ratio);
}

using Verdict = ResultRow::Verdict;

// More of a value: good, bad, or neither.
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

// The change of an amount of which less is better.
Change amount_change(double first, double second) {
  if (!(first > 0) || !std::isfinite(second)) return {};
  const double ratio = second / first;
  return {human_ratio(ratio) + "×", judge(ratio - 1, 0.005, More::kBad)};
}

// Shown to `digits`; what rounds to nothing is no change.
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

// Words of the first column to the left, numbers of the others to the right, a rule under the head.
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

json ratio(double boosted, double baseline) { return baseline != 0 ? json(boosted / baseline) : json(nullptr); }

json ratio(std::uint64_t boosted, std::uint64_t baseline) {
  return ratio(static_cast<double>(boosted), static_cast<double>(baseline));
}

}  // namespace

json to_json(const Results& r) {
  json views = json::array();
  for (const ViewResult& view : r.views) {
    views.push_back(
        {{"name", view.name}, {"psnr", view.psnr}, {"ssim", view.ssim}, {"lpips", optional_number(view.lpips)}});
  }
  json scales = json::array();
  for (const ScaleResult& scale : r.scales) {
    scales.push_back({{"divisor", scale.divisor}, {"psnr", scale.psnr}, {"ssim", scale.ssim}});
  }
  json curve = json::array();
  for (const CurvePoint& point : r.curve) {
    curve.push_back({{"iteration", point.iteration},
                     {"seconds", point.seconds},
                     {"loss", point.loss},
                     {"primitives", point.primitives},
                     {"psnr", optional_number(point.psnr)}});
  }
  return {{"backbone", r.backbone},
          {"boost", r.boost},
          {"iterations", r.iterations},
          {"psnr", r.psnr},
          {"ssim", r.ssim},
          {"lpips", optional_number(r.lpips)},
          {"psnr_beta1", r.psnr_beta1},
          {"split", r.split},
          {"primitives", r.primitives},
          {"train_seconds", r.train_seconds},
          {"fps", r.fps},
          {"peak_memory_bytes", r.peak_memory_bytes},
          {"estimated_memory_bytes", r.estimated_memory_bytes},
          {"storage_bytes", r.storage_bytes},
          {"device", r.device},
          {"machine", r.machine},
          {"threads", r.threads},
          {"seed", r.seed},
          {"version", r.version},
          {"command", r.command},
          {"date", r.date},
          {"source", r.source},
          {"width", r.width},
          {"height", r.height},
          {"views", std::move(views)},
          {"scales", std::move(scales)},
          {"stage_seconds", r.stage_seconds},
          {"curve", std::move(curve)}};
}

Results results_from_json(const json& document) {
  need_object(document, "the file");
  const auto member = [&](const char* key) { return Member(document, "", key); };
  Results r;
  read(member("backbone"), r.backbone);
  read(member("boost"), r.boost);
  read(member("iterations"), r.iterations);
  read(member("psnr"), r.psnr);
  read(member("ssim"), r.ssim);
  read(member("lpips"), r.lpips);
  read(member("psnr_beta1"), r.psnr_beta1);
  read(member("primitives"), r.primitives);
  read(member("train_seconds"), r.train_seconds);
  read(member("fps"), r.fps);
  read(member("peak_memory_bytes"), r.peak_memory_bytes);
  read(member("storage_bytes"), r.storage_bytes);
  read(member("device"), r.device);
  read(member("threads"), r.threads);
  read(member("seed"), r.seed);
  read(member("version"), r.version);
  read_optional(member("estimated_memory_bytes"), r.estimated_memory_bytes);
  read_optional(member("split"), r.split);
  read_optional(member("machine"), r.machine);
  read_optional(member("command"), r.command);
  read_optional(member("date"), r.date);
  read_optional(member("source"), r.source);
  read_optional(member("width"), r.width);
  read_optional(member("height"), r.height);

  const json& views = need_array(member("views"));
  for (std::size_t i = 0; i < views.size(); ++i) {
    const std::string place = "views[" + std::to_string(i) + "]";
    const json& object = need_object(views[i], place);
    ViewResult& view = r.views.emplace_back();
    read(Member(object, place + ".", "name"), view.name);
    read(Member(object, place + ".", "psnr"), view.psnr);
    read(Member(object, place + ".", "ssim"), view.ssim);
    read(Member(object, place + ".", "lpips"), view.lpips);
  }
  if (member("scales").value) {
    const json& scales = need_array(member("scales"));
    for (std::size_t i = 0; i < scales.size(); ++i) {
      const std::string place = "scales[" + std::to_string(i) + "]";
      const json& object = need_object(scales[i], place);
      ScaleResult& scale = r.scales.emplace_back();
      read(Member(object, place + ".", "divisor"), scale.divisor);
      read(Member(object, place + ".", "psnr"), scale.psnr);
      read(Member(object, place + ".", "ssim"), scale.ssim);
    }
  }
  for (const auto& [stage, value] : need_object(member("stage_seconds").need(), "\"stage_seconds\"").items()) {
    read(Member(document.at("stage_seconds"), "stage_seconds.", stage), r.stage_seconds[stage]);
  }
  if (member("curve").value) {
    const json& curve = need_array(member("curve"));
    for (std::size_t i = 0; i < curve.size(); ++i) {
      const std::string place = "curve[" + std::to_string(i) + "]";
      const json& object = need_object(curve[i], place);
      CurvePoint& point = r.curve.emplace_back();
      read(Member(object, place + ".", "iteration"), point.iteration);
      read(Member(object, place + ".", "seconds"), point.seconds);
      read(Member(object, place + ".", "loss"), point.loss);
      read(Member(object, place + ".", "primitives"), point.primitives);
      read(Member(object, place + ".", "psnr"), point.psnr);
    }
  }
  return r;
}

json comparison_to_json(const Results& baseline, const Results& boosted) {
  json differences = {{"psnr", boosted.psnr - baseline.psnr},
                      {"psnr_beta1", boosted.psnr_beta1 - baseline.psnr_beta1},
                      {"ssim", boosted.ssim - baseline.ssim},
                      {"lpips", nullptr}};
  if (baseline.lpips && boosted.lpips) differences["lpips"] = *boosted.lpips - *baseline.lpips;
  return {{"baseline", to_json(baseline)},
          {"boosted", to_json(boosted)},
          {"ratios",
           {{"train_seconds", ratio(boosted.train_seconds, baseline.train_seconds)},
            {"speedup", ratio(baseline.train_seconds, boosted.train_seconds)},
            {"primitives", ratio(boosted.primitives, baseline.primitives)},
            {"storage_bytes", ratio(boosted.storage_bytes, baseline.storage_bytes)},
            {"peak_memory_bytes", ratio(boosted.peak_memory_bytes, baseline.peak_memory_bytes)},
            {"fps", ratio(boosted.fps, baseline.fps)}}},
          {"differences", std::move(differences)}};
}

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
  quality(
      "PSNR", [](const Results& r) -> Optional { return r.psnr; }, 2, " dB", More::kGood);
  quality(
      "PSNR in any viewer (β\u00a0=\u00a01)", [](const Results& r) -> Optional { return r.psnr_beta1; }, 2, " dB",
      More::kGood);
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
