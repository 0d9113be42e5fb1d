// SPDX-License-Identifier: Apache-2.0
/// @file What `splatboost bench` prints of the figures that it writes (docs/formats.md).
#pragma once

#include <span>

#include <nlohmann/json.hpp>

namespace splatboost::program {

/// A stage's name in files, and its title in tables.
struct BenchStage {
  const char* name;
  const char* title;
};
/// In the order of an iteration. "iteration" is all before it and what lies between them; "scoring" is one scored view:
/// render, error map, loss, count replay.
std::span<const BenchStage> bench_stages();

/// Times by stage and scene. @param old an earlier file, whose times it sets these against; or null
void print_times(const nlohmann::json& now, const nlohmann::json* old);
/// The CPU's limits, and how near blending comes to them.
void print_blend_work(const nlohmann::json& now);
/// A GPU's limits, and how near each stage comes to them.
void print_efforts(const nlohmann::json& now);
void print_scaling(const nlohmann::json& scaling);

}  // namespace splatboost::program
