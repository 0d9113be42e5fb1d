// SPDX-License-Identifier: Apache-2.0
/// @file The amount of work of each stage of a training iteration on a CUDA device, counted rather than timed.
#pragma once

#include <map>
#include <string>

#include "program/bench/blend_work.h"
#include "splatboost/camera.h"

namespace splatboost::program {

/// Efforts of the stages that cuda_bench.h times, by name: what the formulas and data need at least, independent of how
/// a kernel is written.
///
/// Operations: those of the formulas (*_math.h), counted as in blend_work.h; a division, a root, a logarithm and a
/// power count as one each. Blending counts all 8 × 4 pixels of a warp's instruction for each splat that blends one of
/// them, but not the tests that skip the other splats. Bytes: what a stage reads from and writes to device memory, each
/// once per Gaussian, entry, warp's splat or pixel; a sort reads and writes keys and values once for each 8 bits of the
/// key. Caches save part of this.
/// @param work counted by kInstructionPixels
/// @param warps (warp, splat) pairs with at least one blended pixel: cells of kWarpPixels
std::map<std::string, Effort> cuda_efforts(const BlendWork& work, std::uint64_t warps, const Camera& camera,
                                           std::size_t splats);

}  // namespace splatboost::program
