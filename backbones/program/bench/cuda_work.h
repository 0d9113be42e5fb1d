// SPDX-License-Identifier: Apache-2.0
/// @file How much work each stage of a training iteration is on a CUDA device, counted rather than timed.
#pragma once

#include <map>
#include <string>

#include "program/bench/blend_work.h"
#include "splatboost/camera.h"

namespace splatboost::program {

/// Efforts of the stages that cuda_bench.h times, by their names: what the formulas and data cannot do without, however
/// a kernel goes about it.
///
/// Operations: those of the formulas (*_math.h), counted as in blend_work.h; a division, a root, a logarithm and a
/// power are one each. Of blending, those of all 8 × 4 pixels of a warp's instruction for each splat that one of them
/// blends: not the tests that leave out the others. Bytes: what a stage reads and writes of the device's memory, each
/// once a Gaussian, an entry, a warp's splat or a pixel; of a sort, keys and values to and fro once for each 8 bits of
/// the key. Caches spare a part of them.
/// @param work counted by kInstructionPixels
/// @param warps (warp, splat) pairs with at least one blended pixel: cells of kWarpPixels
std::map<std::string, Effort> cuda_efforts(const BlendWork& work, std::uint64_t warps, const Camera& camera,
                                           std::size_t splats);

}  // namespace splatboost::program
