// SPDX-License-Identifier: Apache-2.0
#include "program/bench/bench_figures.h"

#include <algorithm>

#include "program/bench/bench_tables.h"

namespace splatboost::program {
namespace {

using Json = nlohmann::json;

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return n % 2 == 1 ? values[n / 2] : 0.5 * (values[n / 2 - 1] + values[n / 2]);
}

}  // namespace

Json medians_json(const BenchSamples& samples) {
  Json milliseconds = Json::object();
  for (const BenchStage& stage : bench_stages()) {
    const auto found = samples.find(stage.name);
    if (found != samples.end()) milliseconds[stage.name] = median(found->second);
  }
  return milliseconds;
}

Json limits_json(const MachineLimits& limits) {
  return {{"bytes_per_second", limits.bytes_per_second}, {"operations_per_second", limits.operations_per_second}};
}

Json effort_json(const Effort& effort, double milliseconds, const MachineLimits& limits) {
  const double seconds = 1e-3 * milliseconds;
  return {{"operations", effort.operations},
          {"bytes", effort.bytes},
          {"share_of_operations", effort.operations / seconds / limits.operations_per_second},
          {"share_of_bytes", effort.bytes / seconds / limits.bytes_per_second}};
}

Json scene_json(const BenchSize& size, const BlendWork& work, const Json& milliseconds) {
  return {{"name", size.name},
          {"splats", size.splats},
          {"width", size.width},
          {"height", size.height},
          {"blended_per_pixel", static_cast<double>(work.pairs) / static_cast<double>(work.pixels)},
          {"milliseconds", milliseconds}};
}

}  // namespace splatboost::program
