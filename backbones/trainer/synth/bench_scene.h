// SPDX-License-Identifier: Apache-2.0
/// @file Fixed scenes for all speed measurements: `splatboost bench` and the benchmarks of the kernels.
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
  double deviation = 3.2;  ///< geometric mean of the standard deviations of the splats, px
};

/// 20k, 60k and 200k splats at 400×300, 640×480 and 1024×680.
std::span<const BenchSize> bench_sizes();

/// One camera in front of `size.splats` random Gaussians spread evenly over its image, most of them faint, and one
/// photo of smooth noise. In the 60k scene about 56 splats blend per pixel. The same size always gives the same bytes.
struct BenchScene {
  Scene scene;
  SplatCloud cloud;
  std::vector<float> scales, opacities;  ///< the cloud's, activated
  /// Spans of this object's arrays, valid while it lives.
  Gaussians gaussians() const;
};
BenchScene make_bench_scene(const BenchSize& size);

}  // namespace splatboost
