// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <bit>
#include <span>

#include <hwy/contrib/sort/vqsort.h>

#include "projection/tile_lists.h"

namespace splatboost {
namespace {

constexpr std::size_t kWritesAhead = 16;
constexpr std::size_t kAtATime = 8;
constexpr std::size_t kTilesAtATime = 16;

/// Depth in the upper half, slot in the lower: a tile's keys in ascending order are its entries from near to far, ties
/// by index. Depths are positive, so their bits compare as integers.
std::uint64_t key_of(std::uint32_t depth_bits, std::uint32_t slot) {
  return (static_cast<std::uint64_t>(depth_bits) << 32) | slot;
}

}  // namespace

std::uint32_t number_slots(TileLists& lists) {
  const std::size_t pieces = lists.pieces();
  lists.piece_slot.ensure(pieces + 1);
  std::uint64_t total = 0;
  for (std::size_t piece = 0; piece < pieces; ++piece) {
    lists.piece_slot[piece] = static_cast<std::uint32_t>(total);
    const TileListing& last = lists.listings[std::min((piece + 1) * kProjectGrain, lists.primitives) - 1];
    total += std::uint64_t{last.first} + last.tiles;
    check_entries(total);
  }
  lists.piece_slot[pieces] = static_cast<std::uint32_t>(total);
  return lists.piece_slot[pieces];
}

/// Entries are written to their tiles in the order of slots, which is that of the primitives: neighbours in memory are
/// mostly neighbours in space, so that few tiles are written to at a time. Then each tile is sorted, in the cache.
void build_tile_lists(TileLists& lists, const Threads& threads) {
  const std::size_t pieces = lists.pieces();
  const std::size_t tiles = lists.tiles();
  const std::uint32_t total = number_slots(lists);
  const auto listed = [&](std::size_t piece) {
    return std::span<const std::uint32_t>(lists.listed_tiles[piece].data(),
                                          lists.piece_slot[piece + 1] - lists.piece_slot[piece]);
  };

  // One chunk of pieces per thread: each counts its entries per tile, so that all can write to the tiles without locks.
  // The lists do not depend on the number of chunks.
  const auto chunks = static_cast<std::size_t>(threads.count());
  const auto chunk_begin = [&](std::size_t chunk) { return pieces * chunk / chunks; };
  lists.tile_cursor.ensure(chunks * tiles);
  threads.for_range(chunks, 1, [&](std::size_t chunk, std::size_t) {
    std::uint32_t* const count = lists.tile_cursor.data() + chunk * tiles;
    std::fill_n(count, tiles, 0u);
    for (std::size_t piece = chunk_begin(chunk); piece < chunk_begin(chunk + 1); ++piece) {
      for (const std::uint32_t tile : listed(piece)) ++count[tile];
    }
  });
  lists.tile_begin.ensure(tiles + 1);
  std::uint32_t sum = 0;
  for (std::size_t t = 0; t < tiles; ++t) {
    lists.tile_begin[t] = sum;
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
      std::uint32_t& cursor = lists.tile_cursor[chunk * tiles + t];
      const std::uint32_t count = cursor;
      cursor = sum;
      sum += count;
    }
  }
  lists.tile_begin[tiles] = sum;

  lists.entry_keys.ensure(total);
  lists.slot_owner.ensure(total);
  threads.for_range(chunks, 1, [&](std::size_t chunk, std::size_t) {
    const std::size_t last_piece = chunk_begin(chunk + 1);
    // Owners of the slots, eight at a time within the chunk's own slots: the next owner overwrites the excess.
    const std::span<std::uint32_t> owners = lists.slot_owner.span();
    const std::size_t own_end = lists.piece_slot[last_piece];
    std::size_t slot = lists.piece_slot[chunk_begin(chunk)];
    const std::size_t end = std::min(last_piece * kProjectGrain, lists.primitives);
    for (std::size_t i = chunk_begin(chunk) * kProjectGrain; i < end; ++i) {
      const std::size_t stop = slot + lists.listings[i].tiles;
      for (; slot < stop && slot + kAtATime <= own_end; slot += kAtATime) {
        std::fill_n(&owners[slot], kAtATime, static_cast<std::uint32_t>(i));
      }
      for (; slot < stop; ++slot) owners[slot] = static_cast<std::uint32_t>(i);
      slot = stop;
    }
    std::uint32_t* const cursor = lists.tile_cursor.data() + chunk * tiles;
    std::uint64_t* const keys = lists.entry_keys.data();
    for (std::size_t piece = chunk_begin(chunk); piece < last_piece; ++piece) {
      const std::span<const std::uint32_t> tile_of = listed(piece);
      const std::uint32_t first_slot = lists.piece_slot[piece];
      for (std::size_t k = 0; k < tile_of.size(); ++k) {
        __builtin_prefetch(&keys[cursor[tile_of[std::min(k + kWritesAhead, tile_of.size() - 1)]]], 1);
        const std::uint32_t own_slot = first_slot + static_cast<std::uint32_t>(k);
        const auto depth_bits = std::bit_cast<std::uint32_t>(lists.depths[owners[own_slot]]);
        keys[cursor[tile_of[k]]++] = key_of(depth_bits, own_slot);
      }
    }
  });

  lists.entries.ensure(total);
  threads.for_range(tiles, kTilesAtATime, [&](std::size_t begin, std::size_t end) {
    thread_local const hwy::Sorter sort;
    for (std::size_t tile = begin; tile < end; ++tile) {
      const std::uint32_t first = lists.tile_begin[tile], last = lists.tile_begin[tile + 1];
      sort(lists.entry_keys.data() + first, last - first, hwy::SortAscending());
      for (std::uint32_t e = first; e < last; ++e) {
        const auto slot = static_cast<std::uint32_t>(lists.entry_keys[e]);
        lists.entries[e] = {lists.slot_owner[slot], slot};
      }
    }
  });
}

}  // namespace splatboost
