// SPDX-License-Identifier: Apache-2.0
/// @file The primitives of each tile of a view, near to far. A primitive is a Gaussian or a convex: the lists depend
/// only on its depth and its tiles.
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
  std::uint32_t first;  ///< index of the first in the piece's array of listed_tiles
  std::uint32_t tiles;  ///< number of tiles; 0: not drawn
};

/// A primitive in a tile's list.
struct TileEntry {
  std::uint32_t primitive;
  std::uint32_t slot;  ///< index of the entry when entries are grouped by primitive
};

/// Number of primitives in a piece, which one thread projects.
inline constexpr std::size_t kProjectGrain = 512;

/// Results of projection, and the tile lists built from them.
struct TileLists {
  Camera camera;
  std::size_t primitives = 0;
  int tiles_x = 0, tiles_y = 0;

  // Filled by projection.
  Buffer<float> depths;                                  ///< [N] above 0 where listed
  Buffer<TileListing> listings;                          ///< [N]
  std::vector<std::vector<std::uint32_t>> listed_tiles;  ///< one array per piece of kProjectGrain primitives

  Buffer<std::uint32_t> piece_slot;   ///< [pieces + 1] first slot of a piece's primitives
  Buffer<std::uint32_t> slot_owner;   ///< [E] primitive of each slot
  Buffer<std::uint32_t> tile_begin;   ///< [T+1] first entry of a tile
  Buffer<std::uint32_t> tile_cursor;  ///< [chunks, T] counts, then write positions
  Buffer<std::uint64_t> entry_keys;   ///< [E] depth and slot, grouped by tile
  Buffer<TileEntry> entries;          ///< [E] grouped by tile, near to far

  std::size_t tiles() const { return static_cast<std::size_t>(tiles_x) * static_cast<std::size_t>(tiles_y); }
  std::size_t pieces() const { return (primitives + kProjectGrain - 1) / kProjectGrain; }
  /// First slot of a primitive. It has one slot per tile, in the order of its tiles.
  std::size_t first_slot(std::size_t i) const { return piece_slot[i / kProjectGrain] + listings[i].first; }
};

/// Throws ArgumentError if a view has more (tile, primitive) pairs than 32 bits can index.
inline void check_entries(std::uint64_t entries) {
  SPLATBOOST_CHECK(entries <= std::numeric_limits<std::uint32_t>::max(),
                   "a view has more than 2^32 - 1 (tile, primitive) pairs: use smaller images or smaller primitives");
}

/// Fills piece_slot from the listings. @return the number of entries (tiles_cpu.cpp)
std::uint32_t number_slots(TileLists& lists);
/// Fills the tile lists, near to far. (tiles_cpu.cpp)
void build_tile_lists(TileLists& lists, const Threads& threads);

}  // namespace splatboost
