// SPDX-License-Identifier: Apache-2.0
/// @file One convex over one block of pixel columns, row by row: the arithmetic that blending, its gradient and the
/// count replay must share to the last bit, so that all three agree on which pixels a convex reaches.
///
/// Compiled once per instruction set (Highway's per-target include), hence no ordinary include guard.

#if defined(SPLATBOOST_CONVEX_ROWS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_CONVEX_ROWS_INL_H_
#undef SPLATBOOST_CONVEX_ROWS_INL_H_
#else
#define SPLATBOOST_CONVEX_ROWS_INL_H_
#endif

#include <cstdint>
#include <cstring>

#include <hwy/highway.h>

#include "convexes/convex_frame.h"
#include "device/lanes-inl.h"
#include "rasterizer/tile_rows-inl.h"
#include "splatboost/constants.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

/// An edge whose term lies this far below the greatest is negligible: even seven of them add less than half a unit in
/// the last place to the sum. Its share of the gradient is neglected too.
inline constexpr float kNoPart = -28.0f;
/// Exponents of powers of two are clamped to this range.
inline constexpr float kMinExponent = -126.0f, kMaxExponent = 100.0f;

/// Calls body(number of edges, a compile-time constant): hulls of fewer edges are padded with edges that never
/// contribute.
template <class Body>
HWY_INLINE void with_edges(const ConvexRecord& convex, const Body& body) {
  if (convex.edges <= 4) {
    body(std::integral_constant<int, 4>());
  } else if (convex.edges == 5) {
    body(std::integral_constant<int, 5>());
  } else if (convex.edges == 6) {
    body(std::integral_constant<int, 6>());
  } else {
    body(std::integral_constant<int, kMaxConvexPoints>());
  }
}

/// A tile's records are scattered among the view's: prefetch each of them ahead of its use.
HWY_INLINE void prefetch_convex(const ConvexFrame& frame, std::uint32_t at, std::uint32_t end) {
  constexpr std::uint32_t kAhead = 4;
  if (at + kAhead >= end) return;
  const auto* const record = reinterpret_cast<const char*>(&frame.records[frame.entries[at + kAhead].primitive]);
  for (std::size_t line = 0; line < sizeof(ConvexRecord); line += 64) __builtin_prefetch(record + line);
}

/// Rows of a tile where a convex may reach a block of columns, as a bit mask: those where no edge excludes all pixels
/// between the first and the last centre.
/// @param y first row's pixel centre; @param x_first,x_last pixel centres of the block
HWY_INLINE std::uint32_t rows_near(const ConvexRecord& convex, float y, float x_first, float x_last) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const float first = x_first - convex.centre_x, last = x_last - convex.centre_x;
  std::uint32_t rows = 0;
  for (int row = 0; row < kTileSize; row += lanes) {
    const Vec dy = hn::Sub(hn::Iota(d, y + static_cast<float>(row)), hn::Set(d, convex.centre_y));
    Vec greatest = hn::Set(d, -1e30f);
    for (std::uint32_t k = 0; k < convex.edges; ++k) {
      const float nearest = convex.edge_x[k] * (convex.edge_x[k] > 0.0f ? first : last);
      const float slack = 1e-4f * (std::abs(nearest) + std::abs(convex.edge_offset[k]));
      const Vec constant = hn::Set(d, nearest + convex.edge_offset[k] - slack);
      const Vec in_y = hn::Mul(dy, hn::Set(d, convex.edge_y[k]));
      const Vec least = hn::Sub(hn::Add(constant, in_y), hn::Mul(hn::Abs(in_y), hn::Set(d, 1e-4f)));
      greatest = hn::Max(greatest, least);
    }
    std::uint8_t bits[8] = {};
    hn::StoreMaskBits(d, hn::Le(greatest, hn::Set(d, convex.farthest)), bits);
    std::uint32_t found;
    std::memcpy(&found, bits, sizeof found);
    rows |= found << row;
  }
  return rows;
}

/// The terms t_k of a convex over a block of columns: constant_k(x) + dy·edge_y[k].
template <int kEdges>
struct EdgeColumns {
  Vec dx;  ///< pixel centre − convex's centre
  Vec constant[kEdges];

  HWY_INLINE EdgeColumns(const ConvexRecord& convex, int x0) {
    const Lanes d;
    dx = hn::Sub(hn::Iota(d, static_cast<float>(x0) + 0.5f), hn::Set(d, convex.centre_x));
    for (int k = 0; k < kEdges; ++k) {
      constant[k] = hn::MulAdd(dx, hn::Set(d, convex.edge_x[k]), hn::Set(d, convex.edge_offset[k]));
    }
  }
};

/// log2 of x in [1, 8]; polynomial of log2(m)/(m - 1) for the mantissa m from √½ to √2, absolute error 1e-7.
HWY_INLINE Vec log2_of_sum(Vec x) {
  const Lanes d;
  const hn::RebindToSigned<Lanes> di;
  const auto bits = hn::BitCast(di, x);
  const auto exponent = hn::ShiftRight<23>(hn::Sub(bits, hn::Set(di, 0x3F3504F3)));  // 0x3F3504F3: bits of √½
  const Vec f = hn::Sub(hn::BitCast(d, hn::Sub(bits, hn::ShiftLeft<23>(exponent))), hn::Set(d, 1.0f));
  Vec p = hn::Set(d, 0.12569394707679749f);
  p = hn::MulAdd(p, f, hn::Set(d, -0.21005961298942566f));
  p = hn::MulAdd(p, f, hn::Set(d, 0.2171337902545929f));
  p = hn::MulAdd(p, f, hn::Set(d, -0.23855076730251312f));
  p = hn::MulAdd(p, f, hn::Set(d, 0.2876938283443451f));
  p = hn::MulAdd(p, f, hn::Set(d, -0.360720157623291f));
  p = hn::MulAdd(p, f, hn::Set(d, 0.4809206426143646f));
  p = hn::MulAdd(p, f, hn::Set(d, -0.7213471531867981f));
  p = hn::MulAdd(p, f, hn::Set(d, 1.442694902420044f));
  return hn::MulAdd(p, f, hn::ConvertTo(d, exponent));
}

/// Effect of one convex on one row of pixels, with more than pass_row() needs.
template <int kEdges>
struct ConvexStep : RowStep {
  Vec phi;           ///< φ₂
  Vec inside;        ///< I
  Vec part[kEdges];  ///< share w_k of an edge in φ₂, times sum
  Vec sum;
};

/// Rows that are processed together: the latency of one is filled with instructions of the other.
inline constexpr int kRowsAtATime = 2;

/// Advances kRowsAtATime rows of transmittances past a convex, from the row at y on. Pixels that are closed or too far
/// for α = 1/255 get alpha = 0 and keep their transmittances.
/// @param stride from one row's transmittances to the next's
/// @return whether there is any other pixel; if not, only dy of steps is set
template <int kEdges>
HWY_INLINE bool step_convex(const ConvexRecord& convex, const EdgeColumns<kEdges>& columns, float y,
                            float* HWY_RESTRICT transmittance, int stride, ConvexStep<kEdges> (&steps)[kRowsAtATime]) {
  const Lanes d;
  Vec greatest[kRowsAtATime], term[kRowsAtATime][kEdges];
  Mask near[kRowsAtATime], any_near, any_sum;
  for (int r = 0; r < kRowsAtATime; ++r) {
    ConvexStep<kEdges>& step = steps[r];
    step.dy = hn::Set(d, y + static_cast<float>(r) - convex.centre_y);
    greatest[r] = hn::Set(d, -1e30f);
    Vec second = greatest[r];
    for (int k = 0; k < kEdges; ++k) {
      term[r][k] = hn::MulAdd(step.dy, hn::Set(d, convex.edge_y[k]), columns.constant[k]);
      second = hn::Max(second, hn::Min(greatest[r], term[r][k]));
      greatest[r] = hn::Max(greatest[r], term[r][k]);
    }
    const Mask open = hn::Gt(hn::Load(d, transmittance + r * stride), hn::Zero(d));
    near[r] = hn::And(open, hn::Le(greatest[r], hn::Set(d, convex.farthest)));
    const Mask sum = hn::And(near[r], hn::Ge(hn::Sub(second, greatest[r]), hn::Set(d, kNoPart)));
    any_near = r == 0 ? near[r] : hn::Or(any_near, near[r]);
    any_sum = r == 0 ? sum : hn::Or(any_sum, sum);
  }
  if (hn::AllFalse(d, any_near)) return false;
  // If a single edge dominates at every open pixel that is near enough, no sum is needed.
  if (hn::AllFalse(d, any_sum)) {
    for (int r = 0; r < kRowsAtATime; ++r) {
      ConvexStep<kEdges>& step = steps[r];
      step.phi = greatest[r];
      step.sum = hn::Set(d, 1.0f);
      for (int k = 0; k < kEdges; ++k) step.part[k] = hn::IfThenElseZero(hn::Eq(term[r][k], greatest[r]), step.sum);
    }
  } else {
    for (int r = 0; r < kRowsAtATime; ++r) steps[r].sum = hn::Zero(d);
    for (int k = 0; k < kEdges; ++k) {
      for (int r = 0; r < kRowsAtATime; ++r) {
        steps[r].part[k] = exp2_of(hn::Max(hn::Sub(term[r][k], greatest[r]), hn::Set(d, kMinExponent)));
        steps[r].sum = hn::Add(steps[r].sum, steps[r].part[k]);
      }
    }
    for (int r = 0; r < kRowsAtATime; ++r) steps[r].phi = hn::Add(greatest[r], log2_of_sum(steps[r].sum));
  }
  for (int r = 0; r < kRowsAtATime; ++r) {
    ConvexStep<kEdges>& step = steps[r];
    const Vec exponent = hn::Mul(step.phi, hn::Set(d, convex.steepness));
    const Vec power = exp2_of(hn::Min(hn::Max(exponent, hn::Set(d, kMinExponent)), hn::Set(d, kMaxExponent)));
    step.inside = hn::Div(hn::Set(d, 1.0f), hn::Add(hn::Set(d, 1.0f), power));
    const Vec alpha = hn::Min(hn::Mul(hn::Set(d, convex.opacity), step.inside), hn::Set(d, kMaxAlpha));
    step.alpha = hn::IfThenElseZero(hn::And(near[r], hn::Ge(alpha, hn::Set(d, kMinAlpha))), alpha);
  }
  for (int r = 0; r < kRowsAtATime; ++r) pass_row(steps[r], transmittance + r * stride);
  return true;
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
