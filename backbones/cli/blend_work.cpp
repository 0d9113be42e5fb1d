// SPDX-License-Identifier: Apache-2.0
#include "cli/blend_work.h"

#include <algorithm>
#include <vector>

#include "splatboost/constants.h"
#include "splatboost/rasterizer.h"

namespace splatboost::cli {
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

/// Rows with a blended pixel, by replays for which a few rows of pixels are flagged: a splat then counts where it has
/// one of them. Flagged rows are so far apart, down and across, that a splat meets one of them only; one of more than
/// 64 × 128 pixels counts too few rows.
std::uint64_t count_rows(Rasterizer& rasterizer, const Camera& camera, std::size_t splats) {
  constexpr std::size_t kRowPeriod = 64, kTilePeriod = 8;
  const auto width = static_cast<std::size_t>(camera.width), height = static_cast<std::size_t>(camera.height);
  std::vector<std::uint8_t> flagged(width * height);
  std::vector<std::int32_t> counts(splats);
  std::uint64_t rows = 0;
  for (std::size_t first_row = 0; first_row < std::min(kRowPeriod, height); ++first_row) {
    for (std::size_t first_tile = 0; first_tile < kTilePeriod; ++first_tile) {
      std::fill(flagged.begin(), flagged.end(), std::uint8_t{0});
      std::fill(counts.begin(), counts.end(), 0);
      for (std::size_t y = first_row; y < height; y += kRowPeriod) {
        for (std::size_t x = first_tile * kTileSize; x < width; x += kTilePeriod * kTileSize) {
          std::fill_n(&flagged[y * width + x], std::min<std::size_t>(kTileSize, width - x), std::uint8_t{1});
        }
      }
      rasterizer.count_flagged(flagged, counts);
      rows += static_cast<std::uint64_t>(std::count_if(counts.begin(), counts.end(), [](int n) { return n > 0; }));
    }
  }
  return rows;
}

}  // namespace

BlendWork count_blend_work(const BenchScene& bench, Threads& threads) {
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
  work.entries = rasterizer.counts().tile_entries;
  std::vector<std::int32_t> counts(bench.cloud.size(), 0);
  rasterizer.count_flagged(std::vector<std::uint8_t>(work.pixels, 1), counts);
  for (const std::int32_t count : counts) work.pairs += static_cast<std::uint64_t>(count);
  work.rows = count_rows(rasterizer, camera, bench.cloud.size());
  return work;
}

Effort blend_effort(const BlendWork& work) {
  const auto rows = static_cast<double>(work.rows), entries = static_cast<double>(work.entries);
  return {kTileSize * (kBlendRow * rows + kBlendEntry * entries),
          (kList + kRows + kRecord) * entries + (kTilePixel + kImagePixel) * static_cast<double>(work.pixels)};
}

Effort blend_backward_effort(const BlendWork& work) {
  const auto rows = static_cast<double>(work.rows), entries = static_cast<double>(work.entries);
  return {
      kTileSize * (kBlendBackwardRow * rows + kBlendBackwardEntry * entries),
      (kList + kRows + kRecord + kMoments) * entries + (kTilePixel + kImagePixel) * static_cast<double>(work.pixels)};
}

}  // namespace splatboost::cli
