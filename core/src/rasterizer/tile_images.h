// SPDX-License-Identifier: Apache-2.0
/// @file Copies between planar images and the tiles that they are blended in.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <span>

#include "projection/tile_lists.h"
#include "splatboost/constants.h"

namespace splatboost {

inline constexpr std::size_t kTilePixels = kTileSize * kTileSize;

/// The part of an image that a tile covers.
struct TileArea {
  std::size_t x0, y0, width, height;
  std::size_t image_width, image_pixels;
  TileArea(const TileLists& lists, std::size_t tile) {
    const auto columns = static_cast<std::size_t>(lists.tiles_x);
    image_width = static_cast<std::size_t>(lists.camera.width);
    const auto image_height = static_cast<std::size_t>(lists.camera.height);
    image_pixels = image_width * image_height;
    x0 = tile % columns * kTileSize;
    y0 = tile / columns * kTileSize;
    width = std::min<std::size_t>(kTileSize, image_width - x0);
    height = std::min<std::size_t>(kTileSize, image_height - y0);
  }
  std::size_t row(std::size_t plane, std::size_t y) const { return plane * image_pixels + (y0 + y) * image_width + x0; }
};

/// Copies a row of an area. Nearly all are as wide as the tile: a constant size compiles to a few moves.
inline void copy_row(const float* from, float* to, std::size_t width) {
  if (width == kTileSize) {
    std::memcpy(to, from, kTileSize * sizeof(float));
  } else {
    std::memcpy(to, from, width * sizeof(float));
  }
}

inline void store_planes(const TileArea& area, const float* tile, std::size_t planes, std::span<float> image) {
  if (image.empty()) return;
  for (std::size_t c = 0; c < planes; ++c) {
    for (std::size_t y = 0; y < area.height; ++y) {
      copy_row(tile + c * kTilePixels + y * kTileSize, image.data() + area.row(c, y), area.width);
    }
  }
}

inline void load_planes(const TileArea& area, std::span<const float> image, std::size_t planes, float* tile) {
  if (image.empty() || area.width * area.height < kTilePixels)
    std::memset(tile, 0, planes * kTilePixels * sizeof(float));
  if (image.empty()) return;
  for (std::size_t c = 0; c < planes; ++c) {
    for (std::size_t y = 0; y < area.height; ++y) {
      copy_row(image.data() + area.row(c, y), tile + c * kTilePixels + y * kTileSize, area.width);
    }
  }
}

}  // namespace splatboost
