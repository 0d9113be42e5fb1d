// SPDX-License-Identifier: Apache-2.0
/// @file The stages of a training iteration on a CUDA device, timed on the bench's scenes: a public call of the core at
/// a time, with the compact box (β = 1) and absolute gradients, as accelerated training makes them.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "splatboost/cuda_stream.h"
#include "trainer/synth/bench_scene.h"

namespace splatboost::program {

/// Milliseconds of each repeat, by stage: activate, project, tile_lists, blend, loss, blend_backward, project_backward,
/// optimizer, iteration (all of these in a row), count (of flagged pixels) and scoring (a view: render, error map,
/// loss, count). Of tile_lists, blend, blend_backward and iteration there is a second value, NAME_per_splat: by the
/// other way of the backward pass (CudaBackward), for which blending keeps states.
///
/// Stages are timed on the device, each while the host is ahead of it. The loss hands its value to the host, so it and
/// the iteration hold the wait for that; scoring is wall time.
using CudaSamples = std::map<std::string, std::vector<double>>;
CudaSamples measure_cuda_stages(const BenchScene& bench, CudaStream& stream, int warm_up, int repeats);

}  // namespace splatboost::program
