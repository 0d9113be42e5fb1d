// SPDX-License-Identifier: Apache-2.0
#include "program/bench/blend_work.h"

#include <vector>

#include "program/bench/count_cells.h"
#include "splatboost/constants.h"
#include "splatboost/rasterizer.h"

namespace splatboost::program {
namespace {

// Operations per pixel of a row. Both directions: exponent 4, power of two 13, clamp 1, transmittance 2.
constexpr double kStep = 20;
constexpr double kBlendRow = kStep + 7;           // weight 1, three colours 6
constexpr double kBlendBackwardRow = kStep + 27;  // slope of alpha 15, colours' slopes 6, weight 1, moments 5
// Operations per entry, for each of its 16 columns or rows. Both directions: the part of the exponent that rows share
// 5, offsets of rows 1.
constexpr double kBlendEntry = 6 + 12;             // greatest exponent of a row
constexpr double kBlendBackwardEntry = 6 + 9 + 9;  // moments of columns, their sums

// Bytes per entry: its place in the lists, the rows it reaches, its splat's record, its sums. Then bytes per pixel.
constexpr double kList = 8, kRows = 2, kRecord = 64, kMoments = 64;
constexpr double kTilePixel = 16;   // colour and alpha of a tile's image
constexpr double kImagePixel = 12;  // colour, or its gradient

}  // namespace

BlendWork count_blend_work(const BenchScene& bench, const PixelCell& cell, const Threads& threads) {
  const Camera& camera = bench.scene.train[0].camera;
  BlendWork work;
  work.pixels = static_cast<std::uint64_t>(camera.width) * static_cast<std::uint64_t>(camera.height);
  std::vector<float> color(3 * work.pixels);
  Rasterizer rasterizer(threads);
  RasterOptions options;
  options.box = BoxPolicy::ellipse;
  RasterImages images;
  images.color = color;
  rasterizer.forward(camera, bench.gaussians(), options, images);
  work.visible = rasterizer.counts().visible;
  work.entries = rasterizer.counts().tile_entries;
  count_pixels(rasterizer, cell, camera, bench.cloud.size(), work);
  return work;
}

Effort blend_effort(const BlendWork& work) {
  const auto rows = static_cast<double>(work.cells), entries = static_cast<double>(work.entries);
  return {kTileSize * (kBlendRow * rows + kBlendEntry * entries),
          (kList + kRows + kRecord) * entries + (kTilePixel + kImagePixel) * static_cast<double>(work.pixels)};
}

Effort blend_backward_effort(const BlendWork& work) {
  const auto rows = static_cast<double>(work.cells), entries = static_cast<double>(work.entries);
  return {
      kTileSize * (kBlendBackwardRow * rows + kBlendBackwardEntry * entries),
      (kList + kRows + kRecord + kMoments) * entries + (kTilePixel + kImagePixel) * static_cast<double>(work.pixels)};
}

}  // namespace splatboost::program
