// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <bit>

#include "device/device_view.h"
#include "device/launch.h"
#include "device/run_cub.h"
#include "projection/cuda_frame.h"
#include "projection/tile_math.h"
#include "splatboost/errors.h"

namespace splatboost::cuda {
namespace {

/// Sorts behind every depth and every tile.
constexpr std::uint32_t kNothing = 0xffffffffu;

int items(std::size_t n) {
  SPLATBOOST_CHECK(n <= kMaxRoom,
                   "a view has more than 2^31 - 1 (tile, Gaussian) pairs: use smaller images or smaller Gaussians");
  return static_cast<int>(n);
}

// Each launch takes 4 µs or more, so several small tasks share a kernel.

/// Writes the visible Gaussians to their places, fills the unused room behind them, and sets totals.visible.
__global__ void __launch_bounds__(kBlockThreads)
    list_kernel(DeviceView<const std::uint8_t> visible, DeviceView<const std::uint32_t> places,
                DeviceView<const SplatRecord> records, DeviceView<std::uint32_t> listed, DeviceView<std::uint32_t> keys,
                DeviceView<FrameTotals> totals) {
  const std::size_t i = element_index();
  const std::size_t room = listed.size();
  if (i == 0) {
    const std::uint32_t found = places[visible.size()];
    totals[0].visible = found;
    totals[0].most_visible = max(totals[0].most_visible, found);
  }
  if (i < visible.size() && visible[i] != 0) {
    const std::uint32_t place = places[i];
    if (place < room) {
      listed[place] = static_cast<std::uint32_t>(i);
      keys[place] = __float_as_uint(records[i].depth);  // depths are positive: their bits compare as integers
    }
  }
  if (i < room && i >= places[visible.size()]) {
    listed[i] = 0;
    keys[i] = kNothing;
  }
}

__global__ void __launch_bounds__(kBlockThreads)
    entry_counts_kernel(DeviceView<const std::uint32_t> order, DeviceView<const std::uint32_t> tile_counts,
                        DeviceView<const FrameTotals> totals, DeviceView<std::uint32_t> counts) {
  const std::size_t k = element_index();
  if (k >= counts.size()) return;
  counts[k] = k < order.size() && k < totals[0].visible ? tile_counts[order[k]] : 0;
}

struct EmitInputs {
  DeviceView<const std::uint32_t> order, offsets;
  DeviceView<const TileBox> boxes;
  DeviceView<const SplatEllipse> ellipses;
  bool square;
  int tiles_x;
};

/// Writes the entries of the Gaussian at place k, exactly as many as projection counted, where the same function finds
/// the tiles.
__device__ void emit(const EmitInputs& in, std::size_t k, const DeviceView<std::uint32_t>& keys,
                     const DeviceView<std::uint32_t>& entries) {
  const std::uint32_t gaussian = in.order[k];
  std::size_t at = in.offsets[k];
  const std::size_t last = in.offsets[k + 1];
  const std::size_t end = last < keys.size() ? last : keys.size();
  const TileBox box = in.boxes[gaussian];
  Ellipse<float> ellipse{};
  if (!in.square) {
    const SplatEllipse e = in.ellipses[gaussian];
    ellipse = {{e.mean_x, e.mean_y}, {e.conic_xx, e.conic_xy, e.conic_yy}, e.t, e.half_width, e.half_height};
  }
  for (std::uint32_t row = box.y_begin; row < box.y_end && at < end; ++row) {
    std::uint32_t x = box.x_begin, x_end = box.x_end;
    if (!in.square) {
      const TileRange<float> tiles = ellipse_tiles_in_row(ellipse, static_cast<float>(row), in.tiles_x);
      x = static_cast<std::uint32_t>(tiles.begin);
      x_end = static_cast<std::uint32_t>(tiles.end);
    }
    for (; x < x_end && at < end; ++x, ++at) {
      keys[at] = row * static_cast<std::uint32_t>(in.tiles_x) + x;
      entries[at] = gaussian;
    }
  }
  for (; at < end; ++at) {
    keys[at] = kNothing;
    entries[at] = gaussian;
  }
}

/// Writes all entries, fills the unused room behind them, empties the tiles' lists, and sets totals.entries.
__global__ void __launch_bounds__(kBlockThreads)
    emit_kernel(EmitInputs in, DeviceView<std::uint32_t> keys, DeviceView<std::uint32_t> entries,
                DeviceView<TileEntries> tiles, DeviceView<FrameTotals> totals) {
  const std::size_t i = element_index();
  const std::uint32_t found = in.offsets[in.offsets.size() - 1];
  if (i == 0) {
    totals[0].entries = found;
    totals[0].most_entries = max(totals[0].most_entries, found);
  }
  if (i < tiles.size()) tiles[i] = {0, 0};
  if (i < keys.size() && i >= found) {
    keys[i] = kNothing;
    entries[i] = 0;
  }
  if (i < in.order.size() && i < totals[0].visible) emit(in, i, keys, entries);
}

__global__ void __launch_bounds__(kBlockThreads)
    ranges_kernel(DeviceView<const std::uint32_t> keys, DeviceView<TileEntries> tiles) {
  const std::size_t e = element_index();
  if (e >= keys.size()) return;
  const std::uint32_t own = keys[e];
  const std::uint32_t before = e > 0 ? keys[e - 1] : kNothing;
  if (own != before) {
    if (own < tiles.size()) tiles[own].begin = static_cast<std::uint32_t>(e);
    if (e > 0 && before < tiles.size()) tiles[before].end = static_cast<std::uint32_t>(e);
  }
  if (e + 1 == keys.size() && own < tiles.size()) tiles[own].end = static_cast<std::uint32_t>(e + 1);
}

}  // namespace

void count_visible(CudaFrame& frame, CudaStream& stream) {
  sum_to_offsets(stream, frame.scratch, "cub::ExclusiveScan of visible", frame.places, items(frame.places.size()));
}

void sort_by_depth(CudaFrame& frame, CudaStream& stream) {
  const std::size_t room = frame.visible_room;
  frame.listed.ensure(room);
  frame.depth_keys.ensure(room);
  frame.depth_keys_swap.ensure(room);
  frame.order.ensure(room);
  launch_each(stream, "list_visible", list_kernel, std::max({frame.gaussians, room, std::size_t{1}}),
              frame.visible.span(), frame.places.span(), frame.records.span(), frame.listed.span(),
              frame.depth_keys.span(), frame.totals.span());
  if (room > 0) {
    run_cub(stream, frame.scratch, "cub::SortPairs by depth", [&](void* memory, std::size_t& bytes) {
      return cub::DeviceRadixSort::SortPairs(memory, bytes, frame.depth_keys.data(), frame.depth_keys_swap.data(),
                                             frame.listed.data(), frame.order.data(), items(room), 0, 32,
                                             handle_of(stream));
    });
  }
  frame.entry_offsets.ensure(room + 1);
  launch_each(stream, "entry_counts", entry_counts_kernel, room + 1, frame.order.span(), frame.tile_counts.span(),
              frame.totals.span(), frame.entry_offsets.span());
  sum_to_offsets(stream, frame.scratch, "cub::ExclusiveScan of entries", frame.entry_offsets, items(room + 1));
}

void build_tile_lists(CudaFrame& frame, CudaStream& stream) {
  const std::size_t room = frame.entry_room;
  const int n = items(room);
  frame.tile_keys.ensure(room);
  frame.tile_keys_swap.ensure(room);
  frame.entries.ensure(room);
  frame.entries_swap.ensure(room);
  frame.tile_entries.ensure(frame.tiles());
  const EmitInputs in{frame.order.span(),
                      frame.entry_offsets.span(),
                      frame.boxes.span(),
                      frame.ellipses.span(),
                      frame.options.box == BoxPolicy::square,
                      frame.tiles_x};
  launch_each(stream, "emit_entries", emit_kernel, std::max({frame.visible_room, room, frame.tiles()}), in,
              frame.tile_keys.span(), frame.entries_swap.span(), frame.tile_entries.span(), frame.totals.span());
  if (room == 0) return;
  const int bits = static_cast<int>(std::bit_width(frame.tiles()));  // kNothing's low bits are greater than every tile
  run_cub(stream, frame.scratch, "cub::SortPairs by tile", [&](void* memory, std::size_t& bytes) {
    return cub::DeviceRadixSort::SortPairs(memory, bytes, frame.tile_keys.data(), frame.tile_keys_swap.data(),
                                           frame.entries_swap.data(), frame.entries.data(), n, 0, bits,
                                           handle_of(stream));
  });
  launch_each(stream, "tile_ranges", ranges_kernel, room, frame.tile_keys_swap.span(), frame.tile_entries.span());
}

}  // namespace splatboost::cuda
