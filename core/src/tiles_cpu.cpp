// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <utility>

#include "frame.h"

namespace splatboost {
namespace {

constexpr std::size_t kListingsAhead = 24, kTilesAhead = 12;
constexpr std::uint32_t kWritesAhead = 16;
constexpr std::uint32_t kAtATime = 8;

/// Gaussians that are listed, near to far, ties by index: a stable radix sort of the depth's bits, which order as
/// integers because depths are positive. Bytes, not wider digits: 256 places that are written in turn stay in the first
/// cache and its table of pages. Each thread sorts a chunk into places of its own.
void sort_by_depth(Frame& frame, Threads& threads) {
  const auto chunks = static_cast<std::size_t>(threads.count());
  frame.order.ensure(frame.gaussians);
  frame.order_swap.ensure(frame.gaussians);
  frame.sort_bins.resize(256 * chunks);
  const auto bins_of = [&](std::size_t chunk) { return frame.sort_bins.data() + 256 * chunk; };

  // One digit: visit(chunk, use) calls use(element) for each of the chunk's elements.
  const auto pass = [&](int shift, const auto& visit) {
    const auto digit = [shift](DepthOrder e) { return (e.depth_bits >> shift) & 255u; };
    threads.for_range(chunks, 1, [&](std::size_t chunk, std::size_t) {
      std::uint32_t* const bins = bins_of(chunk);
      std::fill_n(bins, 256, 0u);
      visit(chunk, [&](DepthOrder e) { ++bins[digit(e)]; });
    });
    std::uint32_t sum = 0;
    for (std::size_t bin = 0; bin < 256; ++bin) {
      for (std::size_t chunk = 0; chunk < chunks; ++chunk) sum += std::exchange(bins_of(chunk)[bin], sum);
    }
    DepthOrder* const to = frame.order_swap.data();
    threads.for_range(chunks, 1, [&](std::size_t chunk, std::size_t) {
      std::uint32_t* const bins = bins_of(chunk);
      visit(chunk, [&](DepthOrder e) { to[bins[digit(e)]++] = e; });
    });
    std::swap(frame.order, frame.order_swap);
    return sum;
  };
  const auto part = [chunks](std::size_t n, std::size_t chunk) { return n * chunk / chunks; };
  const std::size_t count = pass(0, [&](std::size_t chunk, const auto& use) {
    for (std::size_t i = part(frame.gaussians, chunk); i < part(frame.gaussians, chunk + 1); ++i) {
      if (frame.visible[i] == 0) continue;
      use(DepthOrder{std::bit_cast<std::uint32_t>(frame.depths[i]), static_cast<std::uint32_t>(i)});
    }
  });
  for (const int shift : {8, 16, 24}) {
    const DepthOrder* const from = frame.order.data();
    pass(shift, [&](std::size_t chunk, const auto& use) {
      for (std::size_t i = part(count, chunk); i < part(count, chunk + 1); ++i) use(from[i]);
    });
  }
  frame.order.ensure(count);
}

}  // namespace

void build_tile_lists(Frame& frame, Threads& threads) {
  sort_by_depth(frame, threads);
  const std::size_t visible = frame.order.size();
  const std::size_t tiles = frame.tiles();

  // Gaussians are cut into one chunk a thread, in the order of depth. Each chunk writes down its entries, near to far,
  // and counts them a tile, so that chunk after chunk can be sorted into the tiles without locks. The lists do not
  // depend on the number of chunks.
  const auto chunks = static_cast<std::size_t>(threads.count());
  const std::size_t chunk_size = (visible + chunks - 1) / chunks;
  const auto chunk_begin = [&](std::size_t chunk) { return std::min(visible, chunk * chunk_size); };
  frame.chunk_entries.ensure(chunks + 1);
  threads.for_range(chunks, 1, [&](std::size_t chunk, std::size_t) {
    std::uint32_t entries = 0;
    for (std::size_t k = chunk_begin(chunk); k < chunk_begin(chunk + 1); ++k) {
      entries += frame.listings[frame.order[k].gaussian].tiles;
    }
    frame.chunk_entries[chunk] = entries;
  });
  std::uint32_t total = 0;
  for (std::size_t chunk = 0; chunk <= chunks; ++chunk) {
    const std::uint32_t entries = chunk < chunks ? frame.chunk_entries[chunk] : 0;
    frame.chunk_entries[chunk] = total;
    total += entries;
  }
  std::uint32_t slot = 0;
  for (TileListing& listing : frame.listings.span()) {
    listing.slot = slot;
    slot += listing.tiles;
  }

  frame.tile_cursor.ensure(chunks * tiles);
  if (chunks * tiles > 0) std::memset(frame.tile_cursor.data(), 0, chunks * tiles * sizeof(std::uint32_t));
  frame.unsorted_tiles.ensure(total + kAtATime);
  frame.unsorted_entries.ensure(total + kAtATime);
  threads.for_range(chunks, 1, [&](std::size_t chunk, std::size_t) {
    std::uint32_t* const first_tile = frame.unsorted_tiles.data() + frame.chunk_entries[chunk];
    std::uint32_t* tile = first_tile;
    TileEntry* entry = frame.unsorted_entries.data() + frame.chunk_entries[chunk];
    const std::size_t end = chunk_begin(chunk + 1);
    const auto tiles_of = [&](std::uint32_t gaussian) {
      return frame.listed_tiles[gaussian / kProjectGrain].data() + frame.listings[gaussian].first;
    };
    const TileEntry* const last = frame.unsorted_entries.data() + frame.chunk_entries[chunk + 1];
    for (std::size_t k = chunk_begin(chunk); k < end; ++k) {
      // Gaussians are met by depth, which is at random: without this half of the loop's time is waiting.
      if (k + kListingsAhead < end) __builtin_prefetch(&frame.listings[frame.order[k + kListingsAhead].gaussian]);
      if (k + kTilesAhead < end) __builtin_prefetch(tiles_of(frame.order[k + kTilesAhead].gaussian));
      const std::uint32_t gaussian = frame.order[k].gaussian;
      const TileListing listing = frame.listings[gaussian];
      const std::uint32_t* from = tiles_of(gaussian);
      // Eight at a time, as far as the chunk's own part goes: what is too much, the next Gaussian writes over.
      for (std::uint32_t done = 0; done < listing.tiles; done += kAtATime) {
        const auto n = std::min<std::ptrdiff_t>(kAtATime, last - entry - done);
        TileEntry* const to = entry + done;
        if (n == kAtATime) {
          std::memcpy(tile + done, from + done, kAtATime * sizeof(std::uint32_t));
          for (std::uint32_t j = 0; j < kAtATime; ++j) to[j] = {gaussian, listing.slot + done + j};
        } else {
          std::copy_n(from + done, n, tile + done);
          for (std::uint32_t j = 0; j < n; ++j) to[j] = {gaussian, listing.slot + done + j};
        }
      }
      tile += listing.tiles;
      entry += listing.tiles;
    }
    std::uint32_t* const cursor = frame.tile_cursor.data() + chunk * tiles;
    for (const std::uint32_t* t = first_tile; t != tile; ++t) ++cursor[*t];
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

  frame.entries.ensure(total);
  threads.for_range(chunks, 1, [&](std::size_t chunk, std::size_t) {
    std::uint32_t* const cursor = frame.tile_cursor.data() + chunk * tiles;
    TileEntry* const entries = frame.entries.data();
    const std::uint32_t* const tile_of = frame.unsorted_tiles.data();
    const TileEntry* const unsorted = frame.unsorted_entries.data();
    const std::uint32_t end = frame.chunk_entries[chunk + 1];
    for (std::uint32_t e = frame.chunk_entries[chunk]; e < end; ++e) {
      __builtin_prefetch(&entries[cursor[tile_of[std::min(e + kWritesAhead, end - 1)]]], 1);
      entries[cursor[tile_of[e]]++] = unsorted[e];
    }
  });
}

}  // namespace splatboost
