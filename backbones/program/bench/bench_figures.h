// SPDX-License-Identifier: Apache-2.0
/// @file JSON output of `splatboost bench` (docs/formats.md).
#pragma once

#include <map>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "program/bench/blend_work.h"
#include "program/bench/machine_limits.h"
#include "trainer/synth/bench_scene.h"

namespace splatboost::program {

/// Warm-up repeats, which do not count.
inline constexpr int kBenchWarmUp = 3;

/// Milliseconds of each repeat, by stage.
using BenchSamples = std::map<std::string, std::vector<double>>;

/// Medians of the stages of bench_stages() that were measured.
nlohmann::json medians_json(const BenchSamples& samples);
nlohmann::json limits_json(const MachineLimits& limits);
nlohmann::json effort_json(const Effort& effort, double milliseconds, const MachineLimits& limits);
/// The fields that scenes have on every device.
nlohmann::json scene_json(const BenchSize& size, const BlendWork& work, const nlohmann::json& milliseconds);

}  // namespace splatboost::program
