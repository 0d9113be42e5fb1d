// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <bit>
#include <span>

#include <hwy/contrib/sort/vqsort.h>

#include "projection/frame.h"

namespace splatboost {
namespace {

constexpr std::size_t kWritesAhead = 16;
constexpr std::size_t kAtATime = 8;
constexpr std::size_t kTilesAtATime = 16;

/// Depth above, slot below: a tile's keys in rising order are its entries from near to far, ties by index. The depth's
/// bits order as integers because depths are positive.
std::uint64_t key_of(std::uint32_t depth_bits, std::uint32_t slot) {
  return (static_cast<std::uint64_t>(depth_bits) << 32) | slot;
}

}  // namespace

std::uint32_t number_slots(Frame& frame) {
  const std::size_t pieces = frame.pieces();
  frame.piece_slot.ensure(pieces + 1);
  std::uint64_t total = 0;
  for (std::size_t piece = 0; piece < pieces; ++piece) {
    frame.piece_slot[piece] = static_cast<std::uint32_t>(total);
    const TileListing& last = frame.listings[std::min((piece + 1) * kProjectGrain, frame.gaussians) - 1];
    total += std::uint64_t{last.first} + last.tiles;
    check_entries(total);
  }
  frame.piece_slot[pieces] = static_cast<std::uint32_t>(total);
  return frame.piece_slot[pieces];
}

/// Entries are put into their tiles in the order of slots, which follows the Gaussians' own: neighbours in memory are
/// mostly neighbours in space, so that the tiles in turn are few. Then each tile is sorted by itself, in the cache.
void build_tile_lists(Frame& frame, Threads& threads) {
  const std::size_t pieces = frame.pieces();
  const std::size_t tiles = frame.tiles();
  const std::uint32_t total = number_slots(frame);
  const auto listed = [&](std::size_t piece) {
    return std::span<const std::uint32_t>(frame.listed_tiles[piece].data(),
                                          frame.piece_slot[piece + 1] - frame.piece_slot[piece]);
  };

  // One chunk of pieces a thread: each counts its entries a tile, so that all can be put into the tiles without locks.
  // The lists do not depend on the number of chunks.
  const auto chunks = static_cast<std::size_t>(threads.count());
  const auto chunk_begin = [&](std::size_t chunk) { return pieces * chunk / chunks; };
  frame.tile_cursor.ensure(chunks * tiles);
  threads.for_range(chunks, 1, [&](std::size_t chunk, std::size_t) {
    std::uint32_t* const count = frame.tile_cursor.data() + chunk * tiles;
    std::fill_n(count, tiles, 0u);
    for (std::size_t piece = chunk_begin(chunk); piece < chunk_begin(chunk + 1); ++piece) {
      for (const std::uint32_t tile : listed(piece)) ++count[tile];
    }
  });
  frame.tile_begin.ensure(tiles + 1);
  std::uint32_t sum = 0;
  for (std::size_t t = 0; t < tiles; ++t) {
    frame.tile_begin[t] = sum;
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
      std::uint32_t& cursor = frame.tile_cursor[chunk * tiles + t];
      const std::uint32_t count = cursor;
      cursor = sum;
      sum += count;
    }
  }
  frame.tile_begin[tiles] = sum;

  frame.entry_keys.ensure(total);
  frame.slot_gaussian.ensure(total);
  threads.for_range(chunks, 1, [&](std::size_t chunk, std::size_t) {
    const std::size_t last_piece = chunk_begin(chunk + 1);
    // Whose slots they are. Eight at a time, as far as the chunk's own go: what is too much, the next writes over.
    const std::span<std::uint32_t> owners = frame.slot_gaussian.span();
    const std::size_t own_end = frame.piece_slot[last_piece];
    std::size_t slot = frame.piece_slot[chunk_begin(chunk)];
    const std::size_t end = std::min(last_piece * kProjectGrain, frame.gaussians);
    for (std::size_t i = chunk_begin(chunk) * kProjectGrain; i < end; ++i) {
      const std::size_t stop = slot + frame.listings[i].tiles;
      for (; slot < stop && slot + kAtATime <= own_end; slot += kAtATime) {
        std::fill_n(&owners[slot], kAtATime, static_cast<std::uint32_t>(i));
      }
      for (; slot < stop; ++slot) owners[slot] = static_cast<std::uint32_t>(i);
      slot = stop;
    }
    std::uint32_t* const cursor = frame.tile_cursor.data() + chunk * tiles;
    std::uint64_t* const keys = frame.entry_keys.data();
    for (std::size_t piece = chunk_begin(chunk); piece < last_piece; ++piece) {
      const std::span<const std::uint32_t> tile_of = listed(piece);
      const std::uint32_t first_slot = frame.piece_slot[piece];
      for (std::size_t k = 0; k < tile_of.size(); ++k) {
        __builtin_prefetch(&keys[cursor[tile_of[std::min(k + kWritesAhead, tile_of.size() - 1)]]], 1);
        const std::uint32_t own_slot = first_slot + static_cast<std::uint32_t>(k);
        const auto depth_bits = std::bit_cast<std::uint32_t>(frame.depths[owners[own_slot]]);
        keys[cursor[tile_of[k]]++] = key_of(depth_bits, own_slot);
      }
    }
  });

  frame.entries.ensure(total);
  threads.for_range(tiles, kTilesAtATime, [&](std::size_t begin, std::size_t end) {
    thread_local const hwy::Sorter sort;
    for (std::size_t tile = begin; tile < end; ++tile) {
      const std::uint32_t first = frame.tile_begin[tile], last = frame.tile_begin[tile + 1];
      sort(frame.entry_keys.data() + first, last - first, hwy::SortAscending());
      for (std::uint32_t e = first; e < last; ++e) {
        const auto slot = static_cast<std::uint32_t>(frame.entry_keys[e]);
        frame.entries[e] = {frame.slot_gaussian[slot], slot};
      }
    }
  });
}

}  // namespace splatboost
