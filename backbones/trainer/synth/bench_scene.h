// SPDX-License-Identifier: Apache-2.0
/// @file The fixed scenes that every measurement of speed is made on: `splatboost bench` and the kernels' benchmarks.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "splatboost/gaussians.h"
#include "trainer/dataset/scene.h"
#include "trainer/dataset/splat_ply.h"

namespace splatboost {

struct BenchSize {
  std::string name;
  std::size_t splats;
  int width, height;
  double deviation = 3.2;  ///< geometric mean of the ellipses' standard deviations, px
};

/// 20k, 60k and 200k splats at 400×300, 640×480 and 1024×680.
std::span<const BenchSize> bench_sizes();

/// One camera before `size.splats` random ellipses spread evenly over its image, most of them faint, and one photo of
/// smooth noise. About 56 splats blend into a pixel of 60k. Same size, same bytes.
struct BenchScene {
  Scene scene;
  SplatCloud cloud;
  std::vector<float> scales, opacities;  ///< the cloud's, activated
  /// Views of this scene.
  Gaussians gaussians() const;
};
BenchScene make_bench_scene(const BenchSize& size);

}  // namespace splatboost
