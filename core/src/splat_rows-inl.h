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
#include <cstdint>

#include <hwy/highway.h>

#include "frame.h"
#include "splatboost/constants.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Lanes = hn::CappedTag<float, kTileSize>;
using Vec = hn::Vec<Lanes>;
using Mask = hn::Mask<Lanes>;

inline constexpr int kPixels = kTileSize * kTileSize;
/// Alpha's threshold as a base-2 logarithm: comparing exponents spares most exponentials.
inline constexpr float kMinLog2Alpha = -7.994353436858858f;  // log2(1/255)

/// 2^x for x in about [-32, 1]; polynomial fitted at Chebyshev nodes on [-½, ½], relative error 1e-7.
HWY_INLINE Vec exp2_of(Vec x) {
  const Lanes d;
  const hn::RebindToSigned<Lanes> di;
  const Vec whole = hn::Round(x);
  const Vec f = hn::Sub(x, whole);
  Vec p = hn::Set(d, 0.0013390863364671234f);
  p = hn::MulAdd(p, f, hn::Set(d, 0.009676031918322054f));
  p = hn::MulAdd(p, f, hn::Set(d, 0.05550357114219078f));
  p = hn::MulAdd(p, f, hn::Set(d, 0.2402210748530834f));
  p = hn::MulAdd(p, f, hn::Set(d, 0.6931471880262288f));
  p = hn::MulAdd(p, f, hn::Set(d, 1.0000000754548972f));
  const auto exponent = hn::ShiftLeft<23>(hn::Add(hn::ConvertTo(di, whole), hn::Set(di, 127)));
  return hn::Mul(p, hn::BitCast(d, exponent));
}

/// A tile's records lie scattered over the view's: without this the loop waits for memory a fifth of its time.
HWY_INLINE void prefetch_record(const Frame& frame, std::uint32_t at, std::uint32_t end) {
  constexpr std::uint32_t kAhead = 6;
  if (at + kAhead < end) __builtin_prefetch(&frame.records[frame.entries[at + kAhead]]);
}

/// Rows of a tile that a splat can reach, as a bit mask.
HWY_INLINE std::uint32_t rows_in_reach(const BlendRecord& splat, int tile_y) {
  const int begin = std::max(splat.row_begin - tile_y, 0);
  const int end = std::min(splat.row_end - tile_y, kTileSize);
  if (begin >= end) return 0;
  return ((1u << end) - 1u) & ~((1u << begin) - 1u);
}

/// A splat's exponent over a block of columns: log2 α = constant(x) + dy·(linear(x) + quadratic·dy).
struct Columns {
  Vec dx;  ///< pixel centre − mean
  Vec constant;
  Vec linear;
  float quadratic;

  HWY_INLINE Columns(const BlendRecord& splat, int x0) {
    const Lanes d;
    constexpr float kHalfLog2E = 0.7213475204444817f;  // ½·log2(e)
    dx = hn::Sub(hn::Iota(d, static_cast<float>(x0) + 0.5f), hn::Set(d, splat.mean_x));
    constant = hn::MulAdd(hn::Mul(dx, dx), hn::Set(d, -kHalfLog2E * splat.conic_xx), hn::Set(d, splat.log2_opacity));
    linear = hn::Mul(dx, hn::Set(d, -2 * kHalfLog2E * splat.conic_xy));
    quadratic = -kHalfLog2E * splat.conic_yy;
  }

  HWY_INLINE Vec log2_alpha(float dy) const {
    const Lanes d;
    const Vec y = hn::Set(d, dy);
    return hn::MulAdd(y, hn::MulAdd(y, hn::Set(d, quadratic), linear), constant);
  }
};

/// What one splat does to one row of pixels.
struct RowStep {
  Mask blended;   ///< pixels where the splat contributes
  Vec unclamped;  ///< α before the clamp at 0.99
  Vec alpha;
  Vec before;  ///< transmittance before the splat
};

/// Advances the transmittances of a row. A saturated pixel keeps its final transmittance with a minus sign.
/// @return false if the splat reaches no pixel of the row; then nothing is written
HWY_INLINE bool advance_row(const Columns& columns, float dy, float* HWY_RESTRICT transmittance, RowStep& step,
                            bool& saturated) {
  const Lanes d;
  const Vec exponent = columns.log2_alpha(dy);
  const Vec before = hn::Load(d, transmittance);
  Mask reached = hn::And(hn::Ge(exponent, hn::Set(d, kMinLog2Alpha)), hn::Gt(before, hn::Zero(d)));
  if (hn::AllFalse(d, reached)) return false;
  step.unclamped = exp2_of(hn::Max(exponent, hn::Set(d, -32.0f)));
  step.alpha = hn::Min(step.unclamped, hn::Set(d, kMaxAlpha));
  step.before = before;
  const Vec after = hn::NegMulAdd(before, step.alpha, before);
  const Mask full = hn::And(reached, hn::Lt(after, hn::Set(d, kMinTransmittance)));
  step.blended = hn::AndNot(full, reached);
  Vec next = hn::IfThenElse(step.blended, after, before);
  saturated = !hn::AllFalse(d, full);
  if (saturated) next = hn::IfThenElse(full, hn::Neg(before), next);
  hn::Store(next, d, transmittance);
  return true;
}

/// Rows of one block of columns that still have an open pixel, as a bit mask.
HWY_INLINE std::uint32_t open_rows(const float* HWY_RESTRICT transmittance, int x) {
  const Lanes d;
  std::uint32_t open = 0;
  for (int row = 0; row < kTileSize; ++row) {
    const Vec t = hn::Load(d, transmittance + row * kTileSize + x);
    if (!hn::AllFalse(d, hn::Gt(t, hn::Zero(d)))) open |= 1u << row;
  }
  return open;
}

/// Pixels of a tile: transmittance 1, and saturated from the start outside the image.
HWY_INLINE void open_tile(const Camera& camera, int x0, int y0, float* transmittance) {
  for (int y = 0; y < kTileSize; ++y) {
    for (int x = 0; x < kTileSize; ++x) {
      transmittance[y * kTileSize + x] = x0 + x < camera.width && y0 + y < camera.height ? 1.0f : -1.0f;
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
