// SPDX-License-Identifier: Apache-2.0
/// @file The tiles that a count replay has to process.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "projection/tile_lists.h"
#include "splatboost/constants.h"
#include "splatboost/threads.h"

namespace splatboost {

/// Calls body(tile, flags) for each tile with a flagged pixel, in parallel.
/// @param flagged [H,W] non-zero where flagged
/// @param body its flags are [256], 1 or 0, aligned for vector loads
template <class Body>
void for_each_flagged_tile(const TileLists& lists, std::span<const std::uint8_t> flagged, const Threads& threads,
                           const Body& body) {
  const auto width = static_cast<std::size_t>(lists.camera.width);
  const auto height = static_cast<std::size_t>(lists.camera.height);
  const auto columns = static_cast<std::size_t>(lists.tiles_x);
  threads.for_range(lists.tiles(), 1, [&](std::size_t begin, std::size_t end) {
    alignas(64) float tile_flags[kTileSize * kTileSize];
    for (std::size_t tile = begin; tile < end; ++tile) {
      const std::size_t x0 = tile % columns * kTileSize, y0 = tile / columns * kTileSize;
      bool any = false;
      for (std::size_t y = 0; y < kTileSize; ++y) {
        for (std::size_t x = 0; x < kTileSize; ++x) {
          const bool inside = x0 + x < width && y0 + y < height;
          const bool flag = inside && flagged[(y0 + y) * width + x0 + x] != 0;
          tile_flags[y * kTileSize + x] = flag ? 1.0f : 0.0f;
          any |= flag;
        }
      }
      if (any) body(tile, tile_flags);
    }
  });
}

}  // namespace splatboost
