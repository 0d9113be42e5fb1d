// SPDX-License-Identifier: Apache-2.0
#include <bit>

#include "convexes/cuda_convex_frame.h"
#include "device/device_view.h"
#include "device/launch.h"
#include "device/run_cub.h"
#include "splatboost/errors.h"

namespace splatboost::cuda {
namespace {

/// Sorts behind every tile.
constexpr std::uint32_t kNothing = 0xffffffffu;

/// Writes a convex's entries, exactly as many as projection counted, where the same function finds the tiles.
__global__ void __launch_bounds__(kBlockThreads)
    emit_convexes_kernel(ConvexViewpoint view, DeviceView<const ConvexRecord> records,
                         DeviceView<const ConvexTiles> tiles_of, DeviceView<const std::uint32_t> offsets,
                         DeviceView<std::uint64_t> keys, DeviceView<std::uint32_t> entries) {
  const std::size_t i = element_index();
  if (i >= records.size()) return;
  std::size_t at = offsets[i];
  const std::size_t end = offsets[i + 1];
  if (at == end) return;
  const std::uint32_t depth = __float_as_uint(records[i].depth);  // depths are positive: their bits compare as integers
  const auto put = [&](std::uint32_t tile) {
    keys[at] = static_cast<std::uint64_t>(tile) << 32 | depth;
    entries[at++] = static_cast<std::uint32_t>(i);
  };
  for_tile_rows(tiles_of[i], view, [&](int row, int from, int to) {
    for (int x = from; x < to && at < end; ++x) put(static_cast<std::uint32_t>(row * view.tiles_x + x));
  });
  while (at < end) put(kNothing);
}

__global__ void __launch_bounds__(kBlockThreads)
    convex_ranges_kernel(DeviceView<const std::uint64_t> keys, DeviceView<ConvexTileEntries> tiles) {
  const std::size_t e = element_index();
  if (e >= keys.size()) return;
  const auto own = static_cast<std::uint32_t>(keys[e] >> 32);
  const std::uint32_t before = e > 0 ? static_cast<std::uint32_t>(keys[e - 1] >> 32) : kNothing;
  if (e == 0 || own != before) {
    if (own < tiles.size()) tiles[own].begin = static_cast<std::uint32_t>(e);
    if (e > 0 && before < tiles.size()) tiles[before].end = static_cast<std::uint32_t>(e);
  }
  if (e + 1 == keys.size() && own < tiles.size()) tiles[own].end = static_cast<std::uint32_t>(e + 1);
}

}  // namespace

std::size_t build_convex_lists(CudaConvexFrame& frame, CudaStream& stream) {
  sum_to_offsets(stream, frame.scratch, "cub::ExclusiveScan of convex tiles", frame.entry_offsets,
                 static_cast<int>(frame.convexes + 1));
  std::uint32_t total = 0;
  stream.copy_to_host(&total, frame.entry_offsets.data() + frame.convexes, sizeof total);
  SPLATBOOST_CHECK(total < (1u << 31),
                   "a view has more than 2^31 - 1 (tile, convex) pairs: use smaller images or smaller convexes");
  for (DeviceArray<std::uint64_t>* keys : {&frame.keys, &frame.keys_swap}) keys->ensure(total);
  for (DeviceArray<std::uint32_t>* entries : {&frame.entries, &frame.entries_swap}) entries->ensure(total);
  frame.tile_entries.ensure(frame.tiles());
  frame.tile_entries.fill_zero();
  if (total == 0) return 0;
  launch_each(stream, "emit_convexes", emit_convexes_kernel, frame.convexes, frame.view,
              std::as_const(frame.records).span(), std::as_const(frame.tiles_of).span(),
              std::as_const(frame.entry_offsets).span(), frame.keys_swap.span(), frame.entries_swap.span());
  const int bits = 32 + static_cast<int>(std::bit_width(frame.tiles()));  // kNothing's low bits exceed every tile
  // Ties keep the convexes' order: the sort is stable.
  run_cub(stream, frame.scratch, "cub::SortPairs of convexes", [&](void* memory, std::size_t& bytes) {
    return cub::DeviceRadixSort::SortPairs(memory, bytes, frame.keys_swap.data(), frame.keys.data(),
                                           frame.entries_swap.data(), frame.entries.data(), static_cast<int>(total), 0,
                                           bits, handle_of(stream));
  });
  launch_each(stream, "convex_ranges", convex_ranges_kernel, total, std::as_const(frame.keys).span(),
              frame.tile_entries.span());
  return total;
}

}  // namespace splatboost::cuda
