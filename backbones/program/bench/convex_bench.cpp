// SPDX-License-Identifier: Apache-2.0
#include "program/bench/convex_bench.h"

#include <cmath>

#include "convex_splatting/convex_file.h"
#include "convex_splatting/convex_shapes.h"
#include "convex_splatting/convex_splatting.h"
#include "program/bench/count_cells.h"
#include "trainer/support/temporary_folder.h"

namespace splatboost::program {
namespace {

const BenchSize kSize{"convexes", 20000, 400, 300};

constexpr float kRadius = 2.4f;  // standard deviations
// The indicator's exponent is 1 at a distance of kSoftness pixels outside an edge.
constexpr double kSoftness = 1.0;
constexpr double kTerm = 20;  // z·δ·L of one pixel outside an edge: sums over edges matter near corners only

// Operations per pixel of a row. Both directions: six terms 12, the two greatest 18, exponent 1, power of two 15,
// indicator 2, alpha 2, transmittance 2.
constexpr double kStep = 52;
constexpr double kBlendRow = kStep + 7;           // weight 1, three colours 6
constexpr double kBlendBackwardRow = kStep + 53;  // slope of alpha 16, colours' slopes 6, weight 1, of φ 5, edges 25
// Operations per entry, for each of its 16 columns or rows. Both directions: the part of the terms that rows share 13.
constexpr double kBlendEntry = 13 + 30;               // greatest term of a row
constexpr double kBlendBackwardEntry = 13 + 18 + 24;  // moments of columns, their sums

// Bytes as for splats (blend_work.cpp).
constexpr double kList = 8, kRows = 2, kRecord = 160, kMoments = 128;
constexpr double kTilePixel = 16, kImagePixel = 12;

}  // namespace

Convexes ConvexBench::convexes() const {
  Convexes convexes;
  convexes.count = splats.cloud.size();
  convexes.points_per_convex = static_cast<int>(kConvexPoints);
  convexes.points = points;
  convexes.smoothness = smoothness;
  convexes.sharpness = sharpness;
  convexes.opacities = splats.opacities;
  convexes.sh_dc = splats.cloud.sh_dc;
  convexes.sh_rest = splats.cloud.sh_rest;
  convexes.sh_rest_rows = splats.cloud.sh_rest_rows;
  convexes.sh_degree = kMaxShDegree;
  return convexes;
}

const BenchSize& convex_bench_size() { return kSize; }

ConvexBench make_convex_bench(const BenchSize& size) {
  ConvexBench bench;
  bench.splats = make_bench_scene(size);
  const std::size_t n = size.splats;
  const double focal = static_cast<double>(bench.splats.scene.train[0].camera.fx);
  std::vector<float> radii;
  for (std::size_t i = 0; i < n; ++i) {
    const float* const scales = &bench.splats.scales[3 * i];
    radii.push_back(kRadius * std::cbrt(scales[0] * scales[1] * scales[2]));
    const double z = static_cast<double>(bench.splats.cloud.means[3 * i + 2]);
    // An edge is about as long as the radius, in pixels, and L is its length at a pixel outside it.
    const double edge = static_cast<double>(radii.back()) * focal / z;
    bench.smoothness.push_back(static_cast<float>(kTerm / (z * edge)));
    bench.sharpness.push_back(static_cast<float>(1 / (z * kTerm * kSoftness)));
    bench.log_smoothness.push_back(std::log(bench.smoothness.back()));
    bench.log_sharpness.push_back(std::log(bench.sharpness.back()));
  }
  bench.points = spheres(bench.splats.cloud.means, radii);
  return bench;
}

std::unique_ptr<Backbone> make_still_convexes(const ConvexBench& bench, const Threads& threads) {
  ConvexConfig config;
  config.reference_focal = 0;  // as they are, of the pixels of this camera
  config.points_rate_initial = config.points_rate_final = 1e-20;
  config.feature_rate = config.opacity_rate = config.smoothness_rate = 1e-20;
  config.sharpness_rate = config.mask_rate = 1e-20;
  auto backbone = make_convex_splatting({bench.splats.scene, threads}, config);
  const SplatCloud& splats = bench.splats.cloud;
  const TemporaryFolder folder;
  write_convexes(folder.path(), {bench.points,
                                 bench.log_smoothness,
                                 bench.log_sharpness,
                                 splats.logit_opacities,
                                 std::vector<float>(splats.size(), 1.0f),
                                 splats.sh_dc,
                                 splats.sh_rest,
                                 {bench.splats.scene.train[0].camera.fx}});
  backbone->import_model(folder.path());
  backbone->rasterizer_hook().set_beta(1.0f);
  return backbone;
}

BlendWork count_blend_work(const ConvexBench& bench, const PixelCell& cell, const Threads& threads) {
  const Camera& camera = bench.splats.scene.train[0].camera;
  BlendWork work;
  work.pixels = static_cast<std::uint64_t>(camera.width) * static_cast<std::uint64_t>(camera.height);
  std::vector<float> color(3 * work.pixels);
  ConvexRasterizer rasterizer(threads);
  ConvexOptions options;
  options.box = ConvexBox::compact;
  rasterizer.forward(camera, bench.convexes(), options, color);
  work.visible = rasterizer.counts().visible;
  work.entries = rasterizer.counts().tile_entries;
  count_pixels(rasterizer, cell, camera, bench.splats.cloud.size(), work);
  return work;
}

Effort blend_convexes_effort(const BlendWork& work) {
  const auto rows = static_cast<double>(work.cells), entries = static_cast<double>(work.entries);
  return {kTileSize * (kBlendRow * rows + kBlendEntry * entries),
          (kList + kRows + kRecord) * entries + (kTilePixel + kImagePixel) * static_cast<double>(work.pixels)};
}

Effort blend_convexes_backward_effort(const BlendWork& work) {
  const auto rows = static_cast<double>(work.cells), entries = static_cast<double>(work.entries);
  return {
      kTileSize * (kBlendBackwardRow * rows + kBlendBackwardEntry * entries),
      (kList + kRows + kRecord + kMoments) * entries + (kTilePixel + kImagePixel) * static_cast<double>(work.pixels)};
}

}  // namespace splatboost::program
