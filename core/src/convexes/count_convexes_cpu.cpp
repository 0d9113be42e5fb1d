// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "convexes/convex_frame.h"
#include "rasterizer/flagged_tiles.h"
#include "rasterizer/weight_sums.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "convexes/count_convexes_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "convexes/convex_rows-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

/// Replays one tile and adds one integer per convex to `sums`, which do not depend on the order of the tiles.
/// @param rows [blocks] the rows of each block whose pixels count, as a bit mask
/// @param of (step, at_row) ↦ the lanes' contributions of a step at a row: integers whose sum over a tile is below 2^24
template <int kPlanes, typename Of>
HWY_INLINE void sum_convex_tile(const ConvexFrame& frame, std::size_t tile, TileRows<kPlanes>& pixels,
                                const std::uint32_t* rows, std::int32_t* sums, const Of& of) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int blocks = kTileSize / lanes;
  const std::uint32_t begin = frame.tile_begin[tile], stop = begin + frame.tile_stop[tile];
  const std::uint16_t* reached_rows = frame.entry_rows.data() + begin * static_cast<std::size_t>(blocks);
  for (std::uint32_t at = begin; at < stop; ++at) {
    prefetch_convex(frame, at, stop);
    const ConvexRecord& convex = frame.records[frame.entries[at].primitive];
    Vec lane_sums = hn::Zero(d);
    for (int x = 0; x < kTileSize; x += lanes) {
      const std::uint32_t mask = *reached_rows++ & rows[x / lanes];
      if (mask == 0) continue;
      with_edges(convex, [&](auto edges) HWY_ATTR {
        constexpr int kEdges = decltype(edges)::value;
        const EdgeColumns<kEdges> columns(convex, pixels.x0 + x);
        const RowRange range(mask);
        for (int row = range.first; row <= range.last; row += kRowsAtATime) {
          float* const at_row = pixels.at(row, x);
          ConvexStep<kEdges> steps[kRowsAtATime];
          const float y = pixels.first_y + static_cast<float>(row);
          if (!step_convex(convex, columns, y, at_row, pixels.kStride, steps)) continue;
          for (int r = 0; r < kRowsAtATime; ++r) {
            lane_sums =
                hn::Add(lane_sums, hn::IfThenElseZero(steps[r].open, of(steps[r], at_row + r * pixels.kStride)));
          }
        }
      });
    }
    const auto sum = static_cast<std::int32_t>(hn::GetLane(hn::SumOfLanes(d, lane_sums)));
    if (sum > 0) add_weight(sums[frame.entries[at].primitive], sum);  // a count is a sum of weights 1
  }
}

/// Counts one tile's flagged pixels per convex.
/// @param flagged [256] 1 or 0
void count_convex_tile(const ConvexFrame& frame, std::size_t tile, const float* HWY_RESTRICT flagged,
                       std::int32_t* counts) {
  TileRows<2> pixels(frame, tile);              // transmittance, flags
  std::uint32_t flagged_rows[kMaxBlocks] = {};  // the others need no replay: pixels are independent
  load_flags(flagged, pixels, flagged_rows);
  sum_convex_tile(frame, tile, pixels, flagged_rows, counts, [](const auto& step, const float* at_row) HWY_ATTR {
    const Lanes d;
    return hn::IfThenElseZero(hn::Gt(step.alpha, hn::Zero(d)), hn::Load(d, at_row + kTileSize));
  });
}

/// Sums one tile's blending weights per convex.
void weigh_convex_tile(const ConvexFrame& frame, std::size_t tile, std::int32_t* weights) {
  TileRows<1> pixels(frame, tile);
  std::uint32_t all_rows[kMaxBlocks];
  std::fill_n(all_rows, kMaxBlocks, ~0U);
  sum_convex_tile(frame, tile, pixels, all_rows, weights, [](const auto& step, const float*) HWY_ATTR {
    const Lanes d;
    return hn::Round(hn::Mul(hn::Mul(step.before, step.alpha), hn::Set(d, 1 / kWeightUnit)));
  });
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost {
namespace {
HWY_EXPORT(count_convex_tile);
HWY_EXPORT(weigh_convex_tile);
}  // namespace

void count_flagged_convexes(const ConvexFrame& frame, std::span<const std::uint8_t> flagged,
                            std::span<std::int32_t> counts, const Threads& threads) {
  for_each_flagged_tile(frame, flagged, threads, [&](std::size_t tile, const float* flags) {
    HWY_DYNAMIC_DISPATCH(count_convex_tile)(frame, tile, flags, counts.data());
  });
}

void add_convex_weights(const ConvexFrame& frame, std::span<std::int32_t> weights, const Threads& threads) {
  threads.for_range(frame.tiles(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t tile = begin; tile < end; ++tile) {
      HWY_DYNAMIC_DISPATCH(weigh_convex_tile)(frame, tile, weights.data());
    }
  });
}

}  // namespace splatboost
#endif  // HWY_ONCE
