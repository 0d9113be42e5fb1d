// SPDX-License-Identifier: Apache-2.0
/// @file Which primitives each tile of a view lists, near to far. A primitive is a Gaussian or a convex: lists know its
/// depth and its tiles alone.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "device/buffer.h"
#include "splatboost/camera.h"
#include "splatboost/errors.h"
#include "splatboost/threads.h"

namespace splatboost {

/// The tiles that a primitive is listed in.
struct TileListing {
  std::uint32_t first;  ///< in the array of the primitive's piece
  std::uint32_t tiles;  ///< 0: not drawn
};

/// A primitive in a tile's list.
struct TileEntry {
  std::uint32_t primitive;
  std::uint32_t slot;  ///< the entry's place when entries are ordered primitive by primitive
};

/// Primitives that are projected together.
inline constexpr std::size_t kProjectGrain = 512;

/// What projection fills in, and the lists that follow from it.
struct TileLists {
  Camera camera;
  std::size_t primitives = 0;
  int tiles_x = 0, tiles_y = 0;

  // Of projection.
  Buffer<float> depths;                                  ///< [N] above 0 where listed
  Buffer<TileListing> listings;                          ///< [N]
  std::vector<std::vector<std::uint32_t>> listed_tiles;  ///< an array for each piece of kProjectGrain primitives

  Buffer<std::uint32_t> piece_slot;   ///< [pieces + 1] first slot of a piece's primitives
  Buffer<std::uint32_t> slot_owner;   ///< [E] whose slot it is
  Buffer<std::uint32_t> tile_begin;   ///< [T+1] first entry of a tile
  Buffer<std::uint32_t> tile_cursor;  ///< [chunks, T]
  Buffer<std::uint64_t> entry_keys;   ///< [E] depth and slot, tile by tile
  Buffer<TileEntry> entries;          ///< [E] tile by tile, near to far

  std::size_t tiles() const { return static_cast<std::size_t>(tiles_x) * static_cast<std::size_t>(tiles_y); }
  std::size_t pieces() const { return (primitives + kProjectGrain - 1) / kProjectGrain; }
  /// A primitive's slots, one a tile, lie in the order of its tiles; this is the first.
  std::size_t first_slot(std::size_t i) const { return piece_slot[i / kProjectGrain] + listings[i].first; }
};

/// Throws ArgumentError where a view has more (tile, primitive) pairs than 32 bits can number.
inline void check_entries(std::uint64_t entries) {
  SPLATBOOST_CHECK(entries <= std::numeric_limits<std::uint32_t>::max(),
                   "a view has more than 2^32 - 1 (tile, primitive) pairs: use smaller images or smaller primitives");
}

/// Fills piece_slot from the listings. @return how many entries there are (tiles_cpu.cpp)
std::uint32_t number_slots(TileLists& lists);
/// Fills the tile lists, near to far. (tiles_cpu.cpp)
void build_tile_lists(TileLists& lists, Threads& threads);

}  // namespace splatboost
