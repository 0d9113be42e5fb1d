// SPDX-License-Identifier: Apache-2.0
#include <atomic>

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

/// Counts one tile's flagged pixels per splat. Integer sums: the counts do not depend on the order of the tiles.
/// @param flagged [256] 1 or 0
void count_tile(const Frame& frame, std::size_t tile, const float* HWY_RESTRICT flagged, std::int32_t* counts) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int blocks = kTileSize / lanes;
  TileRows<2> pixels(frame, tile);              // transmittance, flags
  std::uint32_t flagged_rows[kMaxBlocks] = {};  // the others need no replay: pixels are independent
  load_flags(flagged, pixels, flagged_rows);

  const std::uint32_t begin = frame.tile_begin[tile], stop = begin + frame.tile_stop[tile];
  const std::uint16_t* reached_rows = frame.entry_rows.data() + begin * static_cast<std::size_t>(blocks);
  for (std::uint32_t at = begin; at < stop; ++at) {
    prefetch_record(frame, at, stop);
    const BlendRecord& splat = frame.records[frame.entries[at].primitive];
    const RowOffsets offsets(splat, pixels.first_y);
    Vec sum = hn::Zero(d);
    for (int b = 0; b < blocks; ++b) {
      const std::uint32_t mask = *reached_rows++ & flagged_rows[b];
      if (mask == 0) continue;
      const Columns columns(splat, pixels.x0 + b * lanes);
      const RowRange rows(mask);
      float* at_pair = pixels.at(rows.first, b * lanes);
      for (int row = rows.first; row <= rows.last; row += 2, at_pair += 2 * pixels.kStride) {
        for (int k = 0; k < 2; ++k) {
          float* const at_row = at_pair + k * pixels.kStride;
          const RowStep step = step_row(columns, offsets.dy[row + k], at_row);
          const Mask blended = hn::And(step.open, hn::Gt(step.alpha, hn::Zero(d)));
          sum = hn::Add(sum, hn::IfThenElseZero(blended, hn::Load(d, at_row + kTileSize)));
        }
      }
    }
    const auto count = static_cast<std::int32_t>(hn::GetLane(hn::SumOfLanes(d, sum)));
    if (count > 0) std::atomic_ref(counts[frame.entries[at].primitive]).fetch_add(count, std::memory_order_relaxed);
  }
}

/// Counts, per splat, one tile's pixels where it is blended and the transmittance in front of it is above a threshold.
void observe_tile(const Frame& frame, std::size_t tile, float min_transmittance, std::int32_t* counts) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int blocks = kTileSize / lanes;
  const Vec least = hn::Set(d, min_transmittance), one = hn::Set(d, 1.0f);
  TileRows<1> pixels(frame, tile);

  const std::uint32_t begin = frame.tile_begin[tile], stop = begin + frame.tile_stop[tile];
  const std::uint16_t* reached_rows = frame.entry_rows.data() + begin * static_cast<std::size_t>(blocks);
  std::uint32_t open_rows[kMaxBlocks] = {};  // rows with a pixel whose transmittance is above the threshold
  for (std::uint32_t at = begin; at < stop; ++at) {
    if ((at - begin) % kBatch == 0) {
      std::uint32_t any = 0;
      for (int b = 0; b < blocks; ++b) {
        open_rows[b] = 0;
        for (int row = 0; row < kTileSize; ++row) {
          const bool open = !hn::AllFalse(d, hn::Gt(hn::Load(d, pixels.at(row, b * lanes)), least));
          open_rows[b] |= static_cast<std::uint32_t>(open) << row;
        }
        any |= open_rows[b];
      }
      if (any == 0) return;
    }
    prefetch_record(frame, at, stop);
    const BlendRecord& splat = frame.records[frame.entries[at].primitive];
    const RowOffsets offsets(splat, pixels.first_y);
    Vec sum = hn::Zero(d);
    for (int b = 0; b < blocks; ++b) {
      const std::uint32_t mask = *reached_rows++ & open_rows[b];
      if (mask == 0) continue;
      const Columns columns(splat, pixels.x0 + b * lanes);
      const RowRange rows(mask);
      float* at_pair = pixels.at(rows.first, b * lanes);
      for (int row = rows.first; row <= rows.last; row += 2, at_pair += 2 * pixels.kStride) {
        for (int k = 0; k < 2; ++k) {
          const RowStep step = step_row(columns, offsets.dy[row + k], at_pair + k * pixels.kStride);
          const Mask observed =
              hn::And(hn::And(step.open, hn::Gt(step.alpha, hn::Zero(d))), hn::Gt(step.before, least));
          sum = hn::Add(sum, hn::IfThenElseZero(observed, one));
        }
      }
    }
    const auto count = static_cast<std::int32_t>(hn::GetLane(hn::SumOfLanes(d, sum)));
    if (count > 0) std::atomic_ref(counts[frame.entries[at].primitive]).fetch_add(count, std::memory_order_relaxed);
  }
}

/// Sums one tile's blending weights per splat.
void weigh_tile(const Frame& frame, std::size_t tile, std::int32_t* weights) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int blocks = kTileSize / lanes;
  const Vec units = hn::Set(d, 1 / kWeightUnit);
  TileRows<1> pixels(frame, tile);

  const std::uint32_t begin = frame.tile_begin[tile], stop = begin + frame.tile_stop[tile];
  const std::uint16_t* reached_rows = frame.entry_rows.data() + begin * static_cast<std::size_t>(blocks);
  for (std::uint32_t at = begin; at < stop; ++at) {
    prefetch_record(frame, at, stop);
    const BlendRecord& splat = frame.records[frame.entries[at].primitive];
    const RowOffsets offsets(splat, pixels.first_y);
    Vec sum = hn::Zero(d);  // integers below 2^17: exact
    for (int b = 0; b < blocks; ++b) {
      const std::uint32_t mask = *reached_rows++;
      if (mask == 0) continue;
      const Columns columns(splat, pixels.x0 + b * lanes);
      const RowRange rows(mask);
      float* at_pair = pixels.at(rows.first, b * lanes);
      for (int row = rows.first; row <= rows.last; row += 2, at_pair += 2 * pixels.kStride) {
        for (int k = 0; k < 2; ++k) {
          const RowStep step = step_row(columns, offsets.dy[row + k], at_pair + k * pixels.kStride);
          const Vec weight = hn::Round(hn::Mul(hn::Mul(step.before, step.alpha), units));
          sum = hn::Add(sum, hn::IfThenElseZero(step.open, weight));
        }
      }
    }
    const auto weight = static_cast<std::int32_t>(hn::GetLane(hn::SumOfLanes(d, sum)));
    if (weight > 0) add_weight(weights[frame.entries[at].primitive], weight);
  }
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
