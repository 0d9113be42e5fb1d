// SPDX-License-Identifier: Apache-2.0
/// @file Results of `splatboost bench --device cuda`.
#pragma once

#include <span>

#include <nlohmann/json.hpp>

#include "program/bench/cuda_limits.h"
#include "splatboost/cuda_stream.h"
#include "splatboost/threads.h"
#include "trainer/synth/bench_scene.h"

namespace splatboost::program {

/// Adds the device, its limits and, for each scene, times, counted work and shares of the limits to a document.
/// @param threads CPU threads for counting the work
void add_cuda_figures(std::span<const BenchSize> sizes, int repeats, CudaStream& stream, const Threads& threads,
                      nlohmann::json& document, const CudaProbe& probe = {});

}  // namespace splatboost::program
