// SPDX-License-Identifier: Apache-2.0
/// @file Times of the stages of a training iteration on a CUDA device, on the bench's scenes. Each stage is one public
/// call of the core, with the compact box (β = 1) and absolute gradients, as in accelerated training.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "splatboost/cuda_stream.h"
#include "trainer/synth/bench_scene.h"

namespace splatboost::program {

/// Milliseconds of each repeat, by stage: activate, project, tile_lists, blend, loss, blend_backward, project_backward,
/// optimizer, iteration (all of these in a row), count (of flagged pixels) and scoring (one view: render, error map,
/// loss, count).
///
/// Stages are timed on the device, with the host running ahead of it; scoring is wall time. The loss does not wait for
/// its value (Photometric::evaluate_ahead()).
using CudaSamples = std::map<std::string, std::vector<double>>;
CudaSamples measure_cuda_stages(const BenchScene& bench, CudaStream& stream, int warm_up, int repeats);

}  // namespace splatboost::program
