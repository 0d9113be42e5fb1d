// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

#include "frame.h"

namespace splatboost {
namespace {

constexpr std::size_t kSplatsAhead = 8;

/// Gaussians that have a bounding box, near to far, ties by index: a stable radix sort of the depth's bits, which order
/// as integers because depths are positive.
void sort_by_depth(Frame& frame) {
  frame.order.ensure(frame.gaussians);
  frame.sort_keys.ensure(frame.gaussians);
  std::size_t count = 0;
  for (std::size_t i = 0; i < frame.gaussians; ++i) {
    if (frame.tile_rows[i] == 0) continue;
    frame.order[count] = static_cast<std::uint32_t>(i);
    frame.sort_keys[count] = frame.depth_bits[i];
    ++count;
  }
  frame.order.ensure(count);
  frame.order_swap.ensure(frame.gaussians);
  frame.sort_keys_swap.ensure(frame.gaussians);

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

void fill_record(const Frame& frame, std::uint32_t gaussian, BlendRecord& record) {
  const Splat& splat = frame.splats[gaussian];
  record.mean_x = splat.mean.x;
  record.mean_y = splat.mean.y;
  record.quadratic_xx = -kHalfLog2E * splat.conic.xx;
  record.quadratic_xy = -2 * kHalfLog2E * splat.conic.xy;
  record.quadratic_yy = -kHalfLog2E * splat.conic.yy;
  record.log2_opacity = splat.opacity > 0.0f ? std::log2(splat.opacity) : -1e30f;
  record.ridge = -splat.conic.xy / splat.conic.xx;
  record.red = splat.color.x;
  record.green = splat.color.y;
  record.blue = splat.color.z;
  record.gaussian = gaussian;
}

}  // namespace

void build_tile_lists(Frame& frame, const Gaussians& gaussians, Threads& threads) {
  sort_by_depth(frame);
  const std::size_t visible = frame.order.size();
  const std::size_t tiles = frame.tiles();
  const auto tiles_x = static_cast<std::size_t>(frame.tiles_x);

  frame.row_begin.ensure(visible + 1);
  std::uint32_t rows = 0;
  for (std::size_t k = 0; k < visible; ++k) {
    frame.row_begin[k] = rows;
    rows += frame.tile_rows[frame.order[k]];
  }
  frame.row_begin[visible] = rows;
  frame.row_spans.ensure(rows);
  frame.first_row.ensure(visible);

  // Splats are cut into one chunk a thread; each counts its entries a tile, so that chunk after chunk can be written
  // without locks. The lists do not depend on the number of chunks.
  const auto chunks = static_cast<std::size_t>(threads.count());
  const std::size_t chunk_size = (visible + chunks - 1) / chunks;
  frame.tile_cursor.ensure(chunks * tiles);
  if (chunks * tiles > 0) std::memset(frame.tile_cursor.data(), 0, chunks * tiles * sizeof(std::uint32_t));
  frame.splat_begin.ensure(frame.gaussians + 1);
  std::memset(frame.splat_begin.data(), 0, (frame.gaussians + 1) * sizeof(std::uint32_t));
  frame.records.ensure(visible);
  frame.visible.ensure(frame.gaussians);
  if (frame.gaussians > 0) std::memset(frame.visible.data(), 0, frame.gaussians);
  const auto extra = static_cast<std::size_t>(frame.extra_channels());
  frame.channels.ensure(visible * extra);

  threads.for_range(chunks, 1, [&](std::size_t chunk, std::size_t) {
    std::uint32_t* cursor = frame.tile_cursor.data() + chunk * tiles;
    const std::size_t end = std::min(visible, (chunk + 1) * chunk_size);
    for (std::size_t k = chunk * chunk_size; k < end; ++k) {
      // Splats are met by depth, which is at random: without this half of the loop's time is waiting.
      if (k + kSplatsAhead < end) __builtin_prefetch(&frame.splats[frame.order[k + kSplatsAhead]]);
      const std::uint32_t gaussian = frame.order[k];
      const Splat& splat = frame.splats[gaussian];
      const bool square = frame.options.box == BoxPolicy::square;
      Ellipse ellipse{};
      if (!square) {
        ellipse = make_ellipse(splat.mean, splat.covariance, splat.conic, frame.options.beta * splat.reach);
      }
      TileRange* spans = frame.row_spans.data() + frame.row_begin[k];
      std::uint32_t listed = 0;
      for (int row = splat.tile_y0; row < splat.tile_y1; ++row) {
        const TileRange span =
            square ? TileRange{splat.tile_x0, splat.tile_x1} : ellipse_tiles_in_row(ellipse, row, frame.tiles_x);
        *spans++ = span;
        std::uint32_t* tile = cursor + static_cast<std::size_t>(row) * tiles_x;
        for (int x = span.begin; x < span.end; ++x) ++tile[x];
        listed += static_cast<std::uint32_t>(std::max(0, span.end - span.begin));
      }
      frame.first_row[k] = splat.tile_y0;
      frame.splat_begin[gaussian] = listed;
      frame.visible[gaussian] = listed > 0;
      if (listed == 0) frame.radii[gaussian] = 0;
      fill_record(frame, gaussian, frame.records[k]);
      float* channels = frame.channels.data() + k * extra;
      const auto features = static_cast<std::size_t>(frame.features);
      for (std::size_t f = 0; f < features; ++f) channels[f] = gaussians.features[gaussian * features + f];
      if (frame.inverse_depth) channels[features] = 1.0f / splat.depth;
    }
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
  std::uint32_t entry = 0;
  for (std::size_t i = 0; i < frame.gaussians; ++i) {
    const std::uint32_t count = frame.splat_begin[i];
    frame.splat_begin[i] = entry;
    entry += count;
  }
  frame.splat_begin[frame.gaussians] = entry;
  frame.entries.ensure(sum);
  frame.slots.ensure(sum);

  threads.for_range(chunks, 1, [&](std::size_t chunk, std::size_t) {
    std::uint32_t* cursor = frame.tile_cursor.data() + chunk * tiles;
    const std::size_t end = std::min(visible, (chunk + 1) * chunk_size);
    for (std::size_t k = chunk * chunk_size; k < end; ++k) {
      const TileRange* spans = frame.row_spans.data() + frame.row_begin[k];
      const TileRange* spans_end = frame.row_spans.data() + frame.row_begin[k + 1];
      std::uint32_t slot = frame.splat_begin[frame.order[k]];
      std::uint32_t* tile = cursor + frame.first_row[k] * tiles_x;
      for (; spans != spans_end; ++spans, tile += tiles_x) {
        for (int x = spans->begin; x < spans->end; ++x) {
          const std::uint32_t position = tile[x]++;
          frame.entries[position] = static_cast<std::uint32_t>(k);
          frame.slots[position] = slot++;
        }
      }
    }
  });
}

}  // namespace splatboost
