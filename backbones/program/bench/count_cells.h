// SPDX-License-Identifier: Apache-2.0
/// @file Counts blended pixels, and cells with blended pixels, by replaying a view; for any kind of primitive.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "program/bench/blend_work.h"
#include "splatboost/camera.h"

namespace splatboost::program {

/// Number of (cell, primitive) pairs with at least one blended pixel. Each replay flags a sparse grid of cells and
/// counts the primitives that blend a pixel of a flagged cell. Flagged cells are 64 pixels apart vertically and 128
/// horizontally, so that a primitive meets only one of them; larger primitives are undercounted.
template <class AnyRasterizer>
std::uint64_t count_cells(AnyRasterizer& rasterizer, const PixelCell& cell, const Camera& camera,
                          std::size_t primitives) {
  constexpr std::size_t kDown = 64, kAcross = 128;
  const auto width = static_cast<std::size_t>(camera.width), height = static_cast<std::size_t>(camera.height);
  std::vector<std::uint8_t> flagged(width * height);
  std::vector<std::int32_t> counts(primitives);
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

/// Sets the pairs and cells of the view that was just drawn. @param work its pixels are set
template <class AnyRasterizer>
void count_pixels(AnyRasterizer& rasterizer, const PixelCell& cell, const Camera& camera, std::size_t primitives,
                  BlendWork& work) {
  std::vector<std::int32_t> counts(primitives, 0);
  rasterizer.count_flagged(std::vector<std::uint8_t>(work.pixels, 1), counts);
  for (const std::int32_t count : counts) work.pairs += static_cast<std::uint64_t>(count);
  work.cells = count_cells(rasterizer, cell, camera, primitives);
}

}  // namespace splatboost::program
