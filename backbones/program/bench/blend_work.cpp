// SPDX-License-Identifier: Apache-2.0
#include "program/bench/blend_work.h"

#include <algorithm>
#include <vector>

#include "splatboost/constants.h"
#include "splatboost/rasterizer.h"

namespace splatboost::program {
namespace {

// Operations a pixel of a row. Both directions: exponent 4, power of two 13, clamp 1, transmittance 2.
constexpr double kStep = 20;
constexpr double kBlendRow = kStep + 7;           // weight 1, three colours 6
constexpr double kBlendBackwardRow = kStep + 27;  // slope of alpha 15, colours' slopes 6, weight 1, moments 5
// Operations an entry, for each of its 16 columns or rows. Both directions: the exponent's part that rows share 5,
// offsets of rows 1.
constexpr double kBlendEntry = 6 + 12;             // greatest exponent of a row
constexpr double kBlendBackwardEntry = 6 + 9 + 9;  // moments of columns, their sums

// Bytes an entry: its place in the lists, the rows it reaches, its splat's record, its sums. Bytes a pixel.
constexpr double kList = 8, kRows = 2, kRecord = 64, kMoments = 64;
constexpr double kTilePixel = 16;   // colour and alpha of a tile's image
constexpr double kImagePixel = 12;  // colour, or its gradient

/// Cells with a blended pixel, by replays for which a few cells are flagged: a splat then counts where it has one of
/// them. Flagged cells are so far apart, down and across, that a splat meets one of them only; one of more than 64 ×
/// 128 pixels counts too few.
std::uint64_t count_cells(Rasterizer& rasterizer, const PixelCell& cell, const Camera& camera, std::size_t splats) {
  constexpr std::size_t kDown = 64, kAcross = 128;
  const auto width = static_cast<std::size_t>(camera.width), height = static_cast<std::size_t>(camera.height);
  std::vector<std::uint8_t> flagged(width * height);
  std::vector<std::int32_t> counts(splats);
  std::uint64_t cells = 0;
  for (std::size_t first_y = 0; first_y < std::min(kDown, height); first_y += cell.height) {
    for (std::size_t first_x = 0; first_x < std::min(kAcross, width); first_x += cell.width) {
      std::fill(flagged.begin(), flagged.end(), std::uint8_t{0});
      std::fill(counts.begin(), counts.end(), 0);
      for (std::size_t cell_y = first_y; cell_y < height; cell_y += kDown) {
        for (std::size_t y = cell_y; y < std::min(cell_y + cell.height, height); ++y) {
          for (std::size_t x = first_x; x < width; x += kAcross) {
            std::fill_n(&flagged[y * width + x], std::min(cell.width, width - x), std::uint8_t{1});
          }
        }
      }
      rasterizer.count_flagged(flagged, counts);
      cells += static_cast<std::uint64_t>(std::count_if(counts.begin(), counts.end(), [](int n) { return n > 0; }));
    }
  }
  return cells;
}

}  // namespace

BlendWork count_blend_work(const BenchScene& bench, const PixelCell& cell, Threads& threads) {
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
  std::vector<std::int32_t> counts(bench.cloud.size(), 0);
  rasterizer.count_flagged(std::vector<std::uint8_t>(work.pixels, 1), counts);
  for (const std::int32_t count : counts) work.pairs += static_cast<std::uint64_t>(count);
  work.cells = count_cells(rasterizer, cell, camera, bench.cloud.size());
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
