// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "frame.h"

namespace splatboost {
namespace {

constexpr std::size_t kSplatsAhead = 16;

/// Gaussians that are listed, near to far, ties by index: a stable radix sort of the depth's bits, which order as
/// integers because depths are positive.
void sort_by_depth(Frame& frame) {
  frame.order.ensure(frame.gaussians);
  frame.order_swap.ensure(frame.gaussians);
  frame.sort_keys.ensure(frame.gaussians);
  frame.sort_keys_swap.ensure(frame.gaussians);
  std::size_t count = 0;
  for (std::size_t i = 0; i < frame.gaussians; ++i) {
    frame.order[count] = static_cast<std::uint32_t>(i);
    frame.sort_keys[count] = std::bit_cast<std::uint32_t>(frame.depths[i]);
    count += frame.visible[i];
  }
  frame.order.ensure(count);

  constexpr int kBits = 11;
  constexpr std::uint32_t kBins = 1u << kBits;
  std::array<std::array<std::uint32_t, kBins>, 3> bins{};
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t key = frame.sort_keys[i];
    ++bins[0][key & (kBins - 1)];
    ++bins[1][(key >> kBits) & (kBins - 1)];
    ++bins[2][key >> (2 * kBits)];
  }
  std::uint32_t* keys = frame.sort_keys.data();
  std::uint32_t* keys_to = frame.sort_keys_swap.data();
  std::uint32_t* order = frame.order.data();
  std::uint32_t* order_to = frame.order_swap.data();
  for (int pass = 0; pass < 3; ++pass) {
    auto& bin = bins[static_cast<std::size_t>(pass)];
    std::uint32_t sum = 0;
    for (std::uint32_t& b : bin) {
      const std::uint32_t n = b;
      b = sum;
      sum += n;
    }
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t to = bin[(keys[i] >> (pass * kBits)) & (kBins - 1)]++;
      keys_to[to] = keys[i];
      order_to[to] = order[i];
    }
    std::swap(keys, keys_to);
    std::swap(order, order_to);
  }
  // Three passes end in the swap buffers.
  if (count > 0) std::memcpy(order_to, order, count * sizeof(std::uint32_t));
}

}  // namespace

void build_tile_lists(Frame& frame, Threads& threads) {
  sort_by_depth(frame);
  const std::size_t visible = frame.order.size();
  const std::size_t tiles = frame.tiles();
  const auto tiles_x = static_cast<std::size_t>(frame.tiles_x);

  // Gaussians are cut into one chunk a thread; each counts its entries a tile, so that chunk after chunk can be written
  // without locks. The lists do not depend on the number of chunks.
  const auto chunks = static_cast<std::size_t>(threads.count());
  const std::size_t chunk_size = (visible + chunks - 1) / chunks;
  frame.tile_cursor.ensure(chunks * tiles);
  if (chunks * tiles > 0) std::memset(frame.tile_cursor.data(), 0, chunks * tiles * sizeof(std::uint32_t));
  // For each Gaussian of a chunk: body(gaussian, cursor of the first row's first tile)
  const auto visit = [&](std::size_t chunk, const auto& body) {
    std::uint32_t* cursor = frame.tile_cursor.data() + chunk * tiles;
    const std::size_t end = std::min(visible, (chunk + 1) * chunk_size);
    for (std::size_t k = chunk * chunk_size; k < end; ++k) {
      // Gaussians are met by depth, which is at random: without this half of the loop's time is waiting.
      if (k + kSplatsAhead < end) __builtin_prefetch(frame.spans_of(frame.order[k + kSplatsAhead]));
      const std::uint32_t gaussian = frame.order[k];
      body(gaussian, cursor + frame.first_row[gaussian] * tiles_x);
    }
  };

  threads.for_range(chunks, 1, [&](std::size_t chunk, std::size_t) {
    visit(chunk, [&](std::uint32_t gaussian, std::uint32_t* row) {
      const TileSpan* span = frame.spans_of(gaussian);
      for (int left = frame.row_count[gaussian]; left > 0; --left, ++span, row += tiles_x) {
        for (int x = span->begin; x < span->end; ++x) ++row[x];
      }
    });
  });

  frame.tile_begin.ensure(tiles + 1);
  std::uint32_t sum = 0;
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    frame.tile_begin[tile] = sum;
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
      std::uint32_t& cursor = frame.tile_cursor[chunk * tiles + tile];
      const std::uint32_t count = cursor;
      cursor = sum;
      sum += count;
    }
  }
  frame.tile_begin[tiles] = sum;
  frame.splat_begin.ensure(frame.gaussians + 1);
  std::uint32_t entry = 0;
  for (std::size_t i = 0; i < frame.gaussians; ++i) {
    frame.splat_begin[i] = entry;
    entry += frame.listed[i];
  }
  frame.splat_begin[frame.gaussians] = entry;
  frame.entries.ensure(sum);
  frame.slots.ensure(sum);

  threads.for_range(chunks, 1, [&](std::size_t chunk, std::size_t) {
    visit(chunk, [&](std::uint32_t gaussian, std::uint32_t* row) {
      const TileSpan* span = frame.spans_of(gaussian);
      std::uint32_t slot = frame.splat_begin[gaussian];
      for (int left = frame.row_count[gaussian]; left > 0; --left, ++span, row += tiles_x) {
        for (int x = span->begin; x < span->end; ++x) {
          const std::uint32_t position = row[x]++;
          frame.entries[position] = gaussian;
          frame.slots[position] = slot++;
        }
      }
    });
  });
}

}  // namespace splatboost
