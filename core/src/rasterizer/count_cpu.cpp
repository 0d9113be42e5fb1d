// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "projection/frame.h"
#include "rasterizer/flagged_tiles.h"
#include "rasterizer/weight_sums.h"
#include "splatboost/rasterizer.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "rasterizer/count_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "rasterizer/splat_rows-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

/// Replays one tile and adds one integer per splat to `sums`, which do not depend on the order of the tiles.
/// @param rows () ↦ [blocks] the rows of each block whose pixels count, as bit masks, before each batch of splats; null
///             if no pixel counts any more
/// @param of (step, at_row) ↦ the lanes' contributions of a step at a row: integers whose sum over a tile is below 2^24
template <int kPlanes, typename Rows, typename Of>
HWY_INLINE void sum_tile(const Frame& frame, std::size_t tile, TileRows<kPlanes>& pixels, std::int32_t* sums,
                         const Rows& rows, const Of& of) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int blocks = kTileSize / lanes;
  const std::uint32_t begin = frame.tile_begin[tile], stop = begin + frame.tile_stop[tile];
  const std::uint16_t* reached_rows = frame.entry_rows.data() + begin * static_cast<std::size_t>(blocks);
  const std::uint32_t* counting = nullptr;
  for (std::uint32_t at = begin; at < stop; ++at) {
    if ((at - begin) % kBatch == 0 && (counting = rows()) == nullptr) return;
    prefetch_record(frame, at, stop);
    const BlendRecord& splat = frame.records[frame.entries[at].primitive];
    const RowOffsets offsets(splat, pixels.first_y);
    Vec lane_sums = hn::Zero(d);
    for (int b = 0; b < blocks; ++b) {
      const std::uint32_t mask = *reached_rows++ & counting[b];
      if (mask == 0) continue;
      const Columns columns(splat, pixels.x0 + b * lanes);
      const RowRange range(mask);
      float* at_pair = pixels.at(range.first, b * lanes);
      for (int row = range.first; row <= range.last; row += 2, at_pair += 2 * pixels.kStride) {
        for (int k = 0; k < 2; ++k) {
          float* const at_row = at_pair + k * pixels.kStride;
          const RowStep step = step_row(columns, offsets.dy[row + k], at_row);
          lane_sums = hn::Add(lane_sums, hn::IfThenElseZero(step.open, of(step, at_row)));
        }
      }
    }
    const auto sum = static_cast<std::int32_t>(hn::GetLane(hn::SumOfLanes(d, lane_sums)));
    if (sum > 0) add_weight(sums[frame.entries[at].primitive], sum);  // a count is a sum of weights 1
  }
}

/// Counts one tile's flagged pixels per splat.
/// @param flagged [256] 1 or 0
void count_tile(const Frame& frame, std::size_t tile, const float* HWY_RESTRICT flagged, std::int32_t* counts) {
  TileRows<2> pixels(frame, tile);              // transmittance, flags
  std::uint32_t flagged_rows[kMaxBlocks] = {};  // the others need no replay: pixels are independent
  load_flags(flagged, pixels, flagged_rows);
  const auto rows = [&]() HWY_ATTR { return flagged_rows; };
  sum_tile(frame, tile, pixels, counts, rows, [](const RowStep& step, const float* at_row) HWY_ATTR {
    const Lanes d;
    return hn::IfThenElseZero(hn::Gt(step.alpha, hn::Zero(d)), hn::Load(d, at_row + kTileSize));
  });
}

/// Counts, per splat, one tile's pixels where it is blended and the transmittance in front of it is above a threshold.
void observe_tile(const Frame& frame, std::size_t tile, float min_transmittance, std::int32_t* counts) {
  TileRows<1> pixels(frame, tile);
  std::uint32_t open_rows[kMaxBlocks] = {};  // rows with a pixel whose transmittance is above the threshold
  const auto rows = [&]() HWY_ATTR -> const std::uint32_t* {
    const Lanes d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    std::uint32_t any = 0;
    for (int x = 0; x < kTileSize; x += lanes) {
      std::uint32_t& open = open_rows[x / lanes] = 0;
      for (int row = 0; row < kTileSize; ++row) {
        const Mask above = hn::Gt(hn::Load(d, pixels.at(row, x)), hn::Set(d, min_transmittance));
        open |= static_cast<std::uint32_t>(!hn::AllFalse(d, above)) << row;
      }
      any |= open;
    }
    return any == 0 ? nullptr : open_rows;
  };
  sum_tile(frame, tile, pixels, counts, rows, [&](const RowStep& step, const float*) HWY_ATTR {
    const Lanes d;
    const Mask observed = hn::And(hn::Gt(step.alpha, hn::Zero(d)), hn::Gt(step.before, hn::Set(d, min_transmittance)));
    return hn::IfThenElseZero(observed, hn::Set(d, 1.0f));
  });
}

/// Sums one tile's blending weights per splat.
void weigh_tile(const Frame& frame, std::size_t tile, std::int32_t* weights) {
  TileRows<1> pixels(frame, tile);
  std::uint32_t all_rows[kMaxBlocks];
  std::fill_n(all_rows, kMaxBlocks, ~0U);
  const auto rows = [&]() HWY_ATTR { return all_rows; };
  sum_tile(frame, tile, pixels, weights, rows, [](const RowStep& step, const float*) HWY_ATTR {
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
HWY_EXPORT(count_tile);
HWY_EXPORT(observe_tile);
HWY_EXPORT(weigh_tile);
}  // namespace

void count_flagged_pixels(const Frame& frame, std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts,
                          const Threads& threads) {
  for_each_flagged_tile(frame, flagged, threads, [&](std::size_t tile, const float* tile_flags) {
    HWY_DYNAMIC_DISPATCH(count_tile)(frame, tile, tile_flags, counts.data());
  });
}

void count_observed_pixels(const Frame& frame, float min_transmittance, std::span<std::int32_t> counts,
                           const Threads& threads) {
  threads.for_range(frame.tiles(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t tile = begin; tile < end; ++tile) {
      HWY_DYNAMIC_DISPATCH(observe_tile)(frame, tile, min_transmittance, counts.data());
    }
  });
}

void add_blending_weights(const Frame& frame, std::span<std::int32_t> weights, const Threads& threads) {
  threads.for_range(frame.tiles(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t tile = begin; tile < end; ++tile) HWY_DYNAMIC_DISPATCH(weigh_tile)(frame, tile, weights.data());
  });
}

}  // namespace splatboost
#endif  // HWY_ONCE
