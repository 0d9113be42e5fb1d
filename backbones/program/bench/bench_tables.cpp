// SPDX-License-Identifier: Apache-2.0
#include "program/bench/bench_tables.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "program/bench/blend_work.h"

namespace splatboost::program {
namespace {

using Json = nlohmann::json;

constexpr BenchStage kStages[] = {
    {"activate", "activate"},
    {"project", "project"},
    {"tile_lists", "sort and bin"},
    {"blend", "blend forward"},
    {"loss", "L1 + SSIM and gradient"},
    {"blend_backward", "blend backward"},
    {"project_backward", "project backward"},
    {"statistics", "statistics"},
    {"optimizer", "Adam, all parameters"},
    {"iteration", "iteration"},
    {"count", "count replay"},
    {"scoring", "scoring a view"},
};

constexpr int kLabel = 26;

std::string label(std::string text) {
  text.resize(kLabel, ' ');
  return text;
}

std::string column(const std::string& text, int width) {
  return std::string(static_cast<std::size_t>(std::max(0, width - static_cast<int>(text.size()))), ' ') + text;
}

std::string fixed(double value, const char* format) {
  char text[32];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

/// Milliseconds of a stage of a scene in a results file; NaN if it has none.
double find_milliseconds(const Json& document, const std::string& scene, const std::string& stage) {
  for (const Json& entry : document.value("scenes", Json::array())) {
    if (!entry.is_object() || entry.value("name", Json()) != scene) continue;
    const Json& value = entry.value("milliseconds", Json::object()).value(stage, Json());
    if (value.is_number()) return value.get<double>();
  }
  return std::nan("");
}

/// The device or machine on which the times were measured.
std::string subject_of(const Json& now) {
  if (now.contains("cuda_runtime")) {
    return now["device"].get<std::string>() + ", CUDA " + now["cuda_runtime"].get<std::string>();
  }
  return now["machine"].get<std::string>() + ", " + std::to_string(now["threads"].get<int>()) + " threads, " +
         now["instruction_set"].get<std::string>();
}

void print_limits(const Json& now, const char* of) {
  const Json& limits = now["limits"];
  std::printf("\nlimits of this %s: %.1f GB/s, %.0f billion operations per second (a multiply-add counts as two)\n", of,
              1e-9 * limits["bytes_per_second"].get<double>(), 1e-9 * limits["operations_per_second"].get<double>());
}

void print_effort(const std::string& title, const Json& effort) {
  std::printf("  %s%7.0f million operations, %3.0f%% of the limit;%6.0f MB, %3.0f%% of the limit\n", title.c_str(),
              1e-6 * effort["operations"].get<double>(), 100 * effort["share_of_operations"].get<double>(),
              1e-6 * effort["bytes"].get<double>(), 100 * effort["share_of_bytes"].get<double>());
}

}  // namespace

std::span<const BenchStage> bench_stages() { return kStages; }

void print_times(const Json& now, const Json* old) {
  constexpr int kColumn = 12, kRatio = 9;
  std::printf("%s; medians of %d, milliseconds%s\n\n", subject_of(now).c_str(), now["repeats"].get<int>(),
              old != nullptr ? "; ratio: old time / new time" : "");
  std::string head(kLabel, ' ');
  for (const Json& scene : now["scenes"]) {
    head += column(scene["name"].get<std::string>(), kColumn);
    if (old != nullptr) head += column("ratio", kRatio);
  }
  std::printf("%s\n", head.c_str());
  const char* const digits = now.contains("cuda_runtime") ? "%.3f" : "%.2f";
  for (const auto& [stage, title] : kStages) {
    if (!now["scenes"][0]["milliseconds"].contains(stage)) continue;
    std::string row = label(title);
    for (const Json& scene : now["scenes"]) {
      const double value = scene["milliseconds"][stage].get<double>();
      row += column(fixed(value, digits), kColumn);
      if (old == nullptr) continue;
      const double before = find_milliseconds(*old, scene["name"].get<std::string>(), stage);
      row += " " + column(std::isnan(before) || value <= 0 ? "-" : fixed(before / value, "%.2fx"), kRatio - 1);
    }
    std::printf("%s\n", row.c_str());
  }
  std::string density = label("splats blended per pixel");
  for (const Json& scene : now["scenes"]) {
    density += column(fixed(scene["blended_per_pixel"].get<double>(), "%.1f"), kColumn);
    if (old != nullptr) density += column("", kRatio);
  }
  std::printf("%s\n", density.c_str());
}

void print_blend_work(const Json& now) {
  print_limits(now, "machine");
  for (const Json& scene : now["scenes"]) {
    const Json& work = scene["blend_work"];
    const double pairs = work["pairs"].get<double>(), rows = work["rows"].get<double>();
    std::printf("%s: %.2f million tile entries, %.2f million rows of 16 pixels, %.0f%% of their pixels blended\n",
                scene["name"].get<std::string>().c_str(), 1e-6 * work["entries"].get<double>(), 1e-6 * rows,
                100 * pairs / (16 * rows));
    print_effort("blend forward  ", work["forward"]);
    print_effort("blend backward ", work["backward"]);
  }
}

void print_efforts(const Json& now) {
  print_limits(now, "GPU");
  for (const Json& scene : now["scenes"]) {
    const Json& work = scene["work"];
    const double pairs = work["pairs"].get<double>(), cells = work["instructions"].get<double>();
    std::printf("%s: %.2f million tile entries, %.2f million of 8x4 pixels, %.0f%% of these pixels blended\n",
                scene["name"].get<std::string>().c_str(), 1e-6 * work["entries"].get<double>(), 1e-6 * cells,
                100 * pairs / (static_cast<double>(kInstructionPixels.pixels()) * cells));
    for (const auto& [stage, title] : kStages) {
      if (scene["efforts"].contains(stage)) print_effort(label(title), scene["efforts"][stage]);
    }
  }
}

void print_scaling(const Json& scaling) {
  std::printf("\nscaling, milliseconds per iteration\n");
  for (const char* of : {"splats", "pixels", "threads"}) {
    if (!scaling.contains(of)) continue;
    std::string row = std::string("by ") + of + ":";
    for (const Json& point : scaling[of]) {
      const std::string at = std::string(of) == "pixels" ? std::to_string(point["width"].get<int>()) + "x" +
                                                               std::to_string(point["height"].get<int>())
                                                         : std::to_string(point[of].get<int>());
      row += "  " + at + " " + fixed(point["milliseconds"]["iteration"].get<double>(), "%.1f");
    }
    std::printf("%s\n", row.c_str());
  }
}

}  // namespace splatboost::program
