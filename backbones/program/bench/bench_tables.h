// SPDX-License-Identifier: Apache-2.0
/// @file Tables that `splatboost bench` prints of its results (docs/formats.md).
#pragma once

#include <span>

#include <nlohmann/json.hpp>

namespace splatboost::program {

/// A stage's name in files, and its title in tables.
struct BenchStage {
  const char* name;
  const char* title;
};
/// In the order of an iteration. "iteration" covers all stages before it and the time between them; "scoring" is one
/// scored view: render, error map, loss, count replay.
std::span<const BenchStage> bench_stages();

/// Prints the times by stage and scene. @param old an earlier file to compare with, or null
void print_times(const nlohmann::json& now, const nlohmann::json* old);
/// Prints the CPU's limits and how close blending comes to them.
void print_blend_work(const nlohmann::json& now);
/// Prints a GPU's limits and how close each stage comes to them.
void print_efforts(const nlohmann::json& now);
void print_scaling(const nlohmann::json& scaling);

}  // namespace splatboost::program
