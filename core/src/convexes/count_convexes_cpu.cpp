// SPDX-License-Identifier: Apache-2.0
#include <atomic>

#include "convexes/convex_frame.h"
#include "rasterizer/flagged_tiles.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "convexes/count_convexes_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once an instruction set
#include <hwy/highway.h>

#include "convexes/convex_rows-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

/// Counts one tile's flagged pixels a convex. Integer sums: any order of tiles gives the same counts.
/// @param flagged [256] 1 or 0
void count_convex_tile(const ConvexFrame& frame, std::size_t tile, const float* HWY_RESTRICT flagged,
                       std::int32_t* counts) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int blocks = kTileSize / lanes;
  TileRows<2> pixels(frame, tile);               // transmittance, flags
  std::uint32_t flagged_rows[kMostBlocks] = {};  // the others need no replay: pixels do not know of one another
  load_flags(flagged, pixels, flagged_rows);
  const std::uint32_t begin = frame.tile_begin[tile], stop = begin + frame.tile_stop[tile];
  const std::uint16_t* reached_rows = frame.entry_rows.data() + begin * static_cast<std::size_t>(blocks);
  for (std::uint32_t at = begin; at < stop; ++at) {
    prefetch_convex(frame, at, stop);
    const ConvexRecord& convex = frame.records[frame.entries[at].primitive];
    Vec sum = hn::Zero(d);
    for (int x = 0; x < kTileSize; x += lanes) {
      const std::uint32_t mask = *reached_rows++ & flagged_rows[x / lanes];
      if (mask == 0) continue;
      with_edges(convex, [&](auto edges) HWY_ATTR {
        constexpr int kEdges = decltype(edges)::value;
        const EdgeColumns<kEdges> columns(convex, pixels.x0 + x);
        const RowRange rows(mask);
        for (int row = rows.first; row <= rows.last; row += kRowsAtATime) {
          float* const at_row = pixels.at(row, x);
          ConvexStep<kEdges> steps[kRowsAtATime];
          const float y = pixels.first_y + static_cast<float>(row);
          if (!step_convex(convex, columns, y, at_row, pixels.kStride, steps)) continue;
          for (int r = 0; r < kRowsAtATime; ++r) {
            const Mask blended = hn::And(steps[r].open, hn::Gt(steps[r].alpha, hn::Zero(d)));
            const Vec flags = hn::Load(d, at_row + r * pixels.kStride + kTileSize);
            sum = hn::Add(sum, hn::IfThenElseZero(blended, flags));
          }
        }
      });
    }
    const auto count = static_cast<std::int32_t>(hn::GetLane(hn::SumOfLanes(d, sum)));
    if (count > 0) std::atomic_ref(counts[frame.entries[at].primitive]).fetch_add(count, std::memory_order_relaxed);
  }
}

/// Sums one tile's blending weights a convex.
void weigh_convex_tile(const ConvexFrame& frame, std::size_t tile, std::int32_t* weights) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int blocks = kTileSize / lanes;
  const Vec units = hn::Set(d, 1 / kWeightUnit);
  TileRows<1> pixels(frame, tile);
  const std::uint32_t begin = frame.tile_begin[tile], stop = begin + frame.tile_stop[tile];
  const std::uint16_t* reached_rows = frame.entry_rows.data() + begin * static_cast<std::size_t>(blocks);
  for (std::uint32_t at = begin; at < stop; ++at) {
    prefetch_convex(frame, at, stop);
    const ConvexRecord& convex = frame.records[frame.entries[at].primitive];
    Vec sum = hn::Zero(d);  // whole numbers below 2^17: exact
    for (int x = 0; x < kTileSize; x += lanes) {
      const std::uint32_t mask = *reached_rows++;
      if (mask == 0) continue;
      with_edges(convex, [&](auto edges) HWY_ATTR {
        constexpr int kEdges = decltype(edges)::value;
        const EdgeColumns<kEdges> columns(convex, pixels.x0 + x);
        const RowRange rows(mask);
        for (int row = rows.first; row <= rows.last; row += kRowsAtATime) {
          ConvexStep<kEdges> steps[kRowsAtATime];
          const float y = pixels.first_y + static_cast<float>(row);
          if (!step_convex(convex, columns, y, pixels.at(row, x), pixels.kStride, steps)) continue;
          for (const ConvexStep<kEdges>& step : steps) {
            const Vec weight = hn::Round(hn::Mul(hn::Mul(step.before, step.alpha), units));
            sum = hn::Add(sum, hn::IfThenElseZero(step.open, weight));
          }
        }
      });
    }
    const auto weight = static_cast<std::int32_t>(hn::GetLane(hn::SumOfLanes(d, sum)));
    if (weight > 0) std::atomic_ref(weights[frame.entries[at].primitive]).fetch_add(weight, std::memory_order_relaxed);
  }
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
                            std::span<std::int32_t> counts, Threads& threads) {
  for_each_flagged_tile(frame, flagged, threads, [&](std::size_t tile, const float* flags) {
    HWY_DYNAMIC_DISPATCH(count_convex_tile)(frame, tile, flags, counts.data());
  });
}

void add_convex_weights(const ConvexFrame& frame, std::span<std::int32_t> weights, Threads& threads) {
  threads.for_range(frame.tiles(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t tile = begin; tile < end; ++tile) {
      HWY_DYNAMIC_DISPATCH(weigh_convex_tile)(frame, tile, weights.data());
    }
  });
}

}  // namespace splatboost
#endif  // HWY_ONCE
