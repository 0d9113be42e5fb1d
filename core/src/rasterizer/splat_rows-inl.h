// SPDX-License-Identifier: Apache-2.0
/// @file One splat over one block of pixel columns, row by row: the arithmetic that blending, its gradient and the
/// count replay must share to the last bit, so that all three agree on which pixels a splat reaches.
///
/// Compiled once an instruction set (Highway's per-target include), hence no ordinary include guard.

#if defined(SPLATBOOST_SPLAT_ROWS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_SPLAT_ROWS_INL_H_
#undef SPLATBOOST_SPLAT_ROWS_INL_H_
#else
#define SPLATBOOST_SPLAT_ROWS_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>

#include <hwy/highway.h>

#include "device/lanes-inl.h"
#include "projection/frame.h"
#include "splatboost/constants.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {
inline constexpr int kPixels = kTileSize * kTileSize;
/// Rows are taken two at a time; behind the tile's last is one whose pixels are closed.
inline constexpr int kSpareRow = kTileSize;
/// Entries of a tile that are handled together: their rows are found in one go, ahead of the branches on them.
inline constexpr std::uint32_t kBatch = 32;
/// Blocks of columns in a tile.
inline constexpr int kMostBlocks = kTileSize;
/// By how much a row's greatest exponent may miss the threshold: more than rounding. The exact test is per pixel.
inline constexpr float kRowSlack = 0.02f;

/// 2^x for x in [-126, 1], anything elsewhere; polynomial fitted at Chebyshev nodes on [-½, ½], relative error 1e-7.
HWY_INLINE Vec exp2_of(Vec x) {
  const Lanes d;
  const hn::RebindToSigned<Lanes> di;
  const Vec shift = hn::Set(d, 12582912.0f);  // 1.5·2^23: the sum's low bits are x, rounded to an integer
  const Vec shifted = hn::Add(x, shift);
  const Vec f = hn::Sub(x, hn::Sub(shifted, shift));
  Vec p = hn::Set(d, 0.0013390863364671234f);
  p = hn::MulAdd(p, f, hn::Set(d, 0.009676031918322054f));
  p = hn::MulAdd(p, f, hn::Set(d, 0.05550357114219078f));
  p = hn::MulAdd(p, f, hn::Set(d, 0.2402210748530834f));
  p = hn::MulAdd(p, f, hn::Set(d, 0.6931471880262288f));
  p = hn::MulAdd(p, f, hn::Set(d, 1.0000000754548972f));
  const auto exponent = hn::ShiftLeft<23>(hn::BitCast(di, shifted));
  return hn::BitCast(d, hn::Add(hn::BitCast(di, p), exponent));
}

/// A tile's records lie scattered over the view's: each is called for ahead of its turn.
HWY_INLINE void prefetch_record(const Frame& frame, std::uint32_t at, std::uint32_t end) {
  constexpr std::uint32_t kAhead = 8;
  if (at + kAhead < end) __builtin_prefetch(&frame.records[frame.entries[at + kAhead].gaussian]);
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

/// dy of a tile's rows, pixel centre − mean, and of the spare row. In memory, because a processor broadcasts a number
/// that it loads at no cost.
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

/// The rows that a mask, which is not empty, stretches over. Rows between its first and its last that are not in it are
/// closed: a splat does nothing to them, nor to the one behind the last.
struct RowRange {
  int first, last;
  HWY_INLINE explicit RowRange(std::uint32_t mask) : first(std::countr_zero(mask)), last(31 - std::countl_zero(mask)) {}
};

/// What one splat does to one row of pixels.
struct RowStep {
  Vec dy;
  Vec alpha;   ///< 0 where it is below the threshold
  Vec before;  ///< transmittance before the splat
  Vec after;   ///< ... and behind it, where it is blended
  Mask open;   ///< pixels that are open afterwards: there, and where α is not 0, the splat was blended
};

/// Takes a row of transmittances behind a splat. A pixel that the splat would saturate is closed before it: it keeps
/// its transmittance with a minus sign, which no later splat brings past the comparison.
HWY_INLINE RowStep step_row(const Columns& columns, float dy, float* HWY_RESTRICT transmittance) {
  const Lanes d;
  RowStep step;
  step.dy = hn::Set(d, dy);
  const Vec exponent = hn::MulAdd(step.dy, hn::MulAdd(step.dy, columns.quadratic, columns.linear), columns.constant);
  const Mask reached = hn::Ge(exponent, hn::Set(d, kMinLog2Alpha));
  step.alpha = hn::IfThenElseZero(reached, hn::Min(exp2_of(exponent), hn::Set(d, kMaxAlpha)));
  step.before = hn::Load(d, transmittance);
  step.after = hn::NegMulAdd(step.before, step.alpha, step.before);
  step.open = hn::Ge(step.after, hn::Set(d, kMinTransmittance));
  hn::Store(hn::IfThenElse(step.open, step.after, hn::Or(step.before, hn::SignBit(d))), d, transmittance);
  return step;
}

/// The part of a tile's state that the loops over rows read and write. What is used together lies together: a row's
/// transmittance, then its other planes. Planes far apart would meet in the low bits of their addresses, and a load
/// that looks like a store in flight waits for it.
/// @tparam kPlanes planes of a row, the transmittance included
template <int kPlanes>
struct TileRows {
  static constexpr int kStride = kPlanes * kTileSize;
  alignas(64) float rows[(kTileSize + 1) * kStride];
  int x0, y0;
  float first_y;  ///< pixel centre of the first row

  /// Transmittance 1, and closed from the start outside the image; the other planes are zero.
  TileRows(const Frame& frame, std::size_t tile) {
    x0 = static_cast<int>(tile % static_cast<std::size_t>(frame.tiles_x)) * kTileSize;
    y0 = static_cast<int>(tile / static_cast<std::size_t>(frame.tiles_x)) * kTileSize;
    first_y = static_cast<float>(y0) + 0.5f;
    const int width = std::min(frame.camera.width - x0, kTileSize);
    const int height = std::min(frame.camera.height - y0, kTileSize);
    std::memset(rows, 0, sizeof rows);
    for (int row = 0; row <= kSpareRow; ++row) {
      for (int x = 0; x < kTileSize; ++x) rows[row * kStride + x] = x < width && row < height ? 1.0f : -1.0f;
    }
  }

  HWY_INLINE float* at(int row, int x, int plane = 0) { return rows + row * kStride + plane * kTileSize + x; }

  /// Rows of a block of columns that still have an open pixel, as a bit mask.
  HWY_INLINE std::uint32_t open_rows(int x) {
    const Lanes d;
    std::uint32_t open = 0;
    for (int row = 0; row < kTileSize; ++row) {
      const bool any = !hn::AllFalse(d, hn::Gt(hn::Load(d, at(row, x)), hn::Zero(d)));
      open |= static_cast<std::uint32_t>(any) << row;
    }
    return open;
  }
};

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
