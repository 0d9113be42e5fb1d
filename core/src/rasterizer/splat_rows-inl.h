// SPDX-License-Identifier: Apache-2.0
/// @file One splat over one block of pixel columns, row by row: the arithmetic that blending, its gradient and the
/// count replay must share to the last bit, so that all three agree on which pixels a splat reaches.
///
/// Compiled once per instruction set (Highway's per-target include), hence no ordinary include guard.

#if defined(SPLATBOOST_SPLAT_ROWS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_SPLAT_ROWS_INL_H_
#undef SPLATBOOST_SPLAT_ROWS_INL_H_
#else
#define SPLATBOOST_SPLAT_ROWS_INL_H_
#endif

#include <cstdint>
#include <cstring>

#include <hwy/highway.h>

#include "device/lanes-inl.h"
#include "projection/frame.h"
#include "rasterizer/tile_rows-inl.h"
#include "splatboost/constants.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {
/// Slack on the threshold of a row's greatest exponent, larger than rounding errors. The exact test is per pixel.
inline constexpr float kRowSlack = 0.02f;

/// A tile's records are scattered among the view's: prefetch each of them ahead of its use.
HWY_INLINE void prefetch_record(const Frame& frame, std::uint32_t at, std::uint32_t end) {
  constexpr std::uint32_t kAhead = 8;
  if (at + kAhead < end) __builtin_prefetch(&frame.records[frame.entries[at + kAhead].primitive]);
}

/// Rows of a tile where a splat reaches a block of columns, as a bit mask: those where the greatest exponent between
/// the first and the last pixel centre passes the threshold.
/// @param y first row's pixel centre; @param x_first,x_last pixel centres of the block
HWY_INLINE std::uint32_t rows_in_reach(const BlendRecord& splat, float y, float x_first, float x_last) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const Vec first = hn::Set(d, x_first - splat.mean_x), last = hn::Set(d, x_last - splat.mean_x);
  std::uint32_t rows = 0;
  for (int row = 0; row < kTileSize; row += lanes) {
    const Vec dy = hn::Sub(hn::Iota(d, y + static_cast<float>(row)), hn::Set(d, splat.mean_y));
    const Vec dx = hn::Max(hn::Min(hn::Mul(dy, hn::Set(d, splat.ridge)), last), first);
    Vec exponent = hn::MulAdd(hn::Mul(dy, dy), hn::Set(d, splat.quadratic_yy), hn::Set(d, splat.log2_opacity));
    const Vec in_x = hn::MulAdd(dx, hn::Set(d, splat.quadratic_xx), hn::Mul(dy, hn::Set(d, splat.quadratic_xy)));
    exponent = hn::MulAdd(dx, in_x, exponent);
    std::uint8_t bits[8] = {};
    hn::StoreMaskBits(d, hn::Ge(exponent, hn::Set(d, kMinLog2Alpha - kRowSlack)), bits);
    std::uint32_t found;
    std::memcpy(&found, bits, sizeof found);
    rows |= found << row;
  }
  return rows;
}

/// A splat's exponent over a block of columns: log2 α = constant(x) + dy·(linear(x) + quadratic·dy).
struct Columns {
  Vec dx;  ///< pixel centre − mean
  Vec constant;
  Vec linear;
  Vec quadratic;

  HWY_INLINE Columns(const BlendRecord& splat, int x0) {
    const Lanes d;
    dx = hn::Sub(hn::Iota(d, static_cast<float>(x0) + 0.5f), hn::Set(d, splat.mean_x));
    constant = hn::MulAdd(hn::Mul(dx, dx), hn::Set(d, splat.quadratic_xx), hn::Set(d, splat.log2_opacity));
    linear = hn::Mul(dx, hn::Set(d, splat.quadratic_xy));
    quadratic = hn::Set(d, splat.quadratic_yy);
  }
};

/// dy of a tile's rows, pixel centre − mean, and of the spare row. Kept in memory because
/// broadcasting a number that is loaded is free.
struct RowOffsets {
  alignas(64) float dy[kTileSize + 1];

  HWY_INLINE RowOffsets(const BlendRecord& splat, float first_y) {
    const Lanes d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    for (int row = 0; row < kTileSize; row += lanes) {
      hn::Store(hn::Sub(hn::Iota(d, first_y + static_cast<float>(row)), hn::Set(d, splat.mean_y)), d, dy + row);
    }
    dy[kSpareRow] = 0.0f;
  }
};

/// Advances a row of transmittances past a splat.
HWY_INLINE RowStep step_row(const Columns& columns, float dy, float* HWY_RESTRICT transmittance) {
  const Lanes d;
  RowStep step;
  step.dy = hn::Set(d, dy);
  const Vec exponent = hn::MulAdd(step.dy, hn::MulAdd(step.dy, columns.quadratic, columns.linear), columns.constant);
  const Mask reached = hn::Ge(exponent, hn::Set(d, kMinLog2Alpha));
  // The rounded conic of a thin splat may be a saddle, whose exponents exceed the range of exp2_of(). 2⁰ > kMaxAlpha.
  const Vec power = exp2_of(hn::Min(exponent, hn::Zero(d)));
  step.alpha = hn::IfThenElseZero(reached, hn::Min(power, hn::Set(d, kMaxAlpha)));
  pass_row(step, transmittance);
  return step;
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
