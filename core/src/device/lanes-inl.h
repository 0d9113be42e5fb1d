// SPDX-License-Identifier: Apache-2.0
/// @file A vector of floats with the operators of a float, so that shared formulas are written once; and conversions
/// between rows [lane, column] in memory and vectors.
///
/// Compiled once per instruction set (Highway's per-target include), hence no ordinary include guard.

#if defined(SPLATBOOST_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_LANES_INL_H_
#undef SPLATBOOST_LANES_INL_H_
#else
#define SPLATBOOST_LANES_INL_H_
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include <hwy/highway.h>

#include <hwy/contrib/math/math-inl.h>

#include "device/host_device.h"
#include "splatboost/constants.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// The lanes of a register, at most one tile row.
using Lanes = hn::CappedTag<float, kTileSize>;
using Vec = hn::Vec<Lanes>;
using Mask = hn::Mask<Lanes>;

struct Bool {
  Mask m;
  friend HWY_INLINE Bool operator&(Bool a, Bool b) { return {hn::And(a.m, b.m)}; }
  friend HWY_INLINE Bool operator|(Bool a, Bool b) { return {hn::Or(a.m, b.m)}; }
};

struct Float {
  Vec v;
  Float() = default;
  HWY_INLINE Float(float a) : v(hn::Set(Lanes(), a)) {}
  HWY_INLINE explicit Float(Vec a) : v(a) {}
  friend HWY_INLINE Float operator+(Float a, Float b) { return Float(hn::Add(a.v, b.v)); }
  friend HWY_INLINE Float operator-(Float a, Float b) { return Float(hn::Sub(a.v, b.v)); }
  friend HWY_INLINE Float operator*(Float a, Float b) { return Float(hn::Mul(a.v, b.v)); }
  friend HWY_INLINE Float operator/(Float a, Float b) { return Float(hn::Div(a.v, b.v)); }
  friend HWY_INLINE Float operator-(Float a) { return Float(hn::Neg(a.v)); }
  HWY_INLINE Float& operator+=(Float a) { return *this = *this + a; }
  friend HWY_INLINE Bool operator<(Float a, Float b) { return {hn::Lt(a.v, b.v)}; }
  friend HWY_INLINE Bool operator>(Float a, Float b) { return {hn::Gt(a.v, b.v)}; }
  friend HWY_INLINE Bool operator>=(Float a, Float b) { return {hn::Ge(a.v, b.v)}; }
};

HWY_INLINE Float min_of(Float a, Float b) { return Float(hn::Min(a.v, b.v)); }
HWY_INLINE Float max_of(Float a, Float b) { return Float(hn::Max(a.v, b.v)); }
HWY_INLINE Float abs_of(Float a) { return Float(hn::Abs(a.v)); }
HWY_INLINE Float sqrt_of(Float a) { return Float(hn::Sqrt(a.v)); }
HWY_INLINE Float floor_of(Float a) { return Float(hn::Floor(a.v)); }
HWY_INLINE Float ceil_of(Float a) { return Float(hn::Ceil(a.v)); }
/// 1/a without a division: the processor's estimate (at least 12 bits on x86, 8 on ARM); one Newton step doubles the
/// number of bits.
HWY_INLINE Float reciprocal_of(Float a) {
  const Vec x = hn::ApproximateReciprocal(a.v);
  return Float(hn::Mul(x, hn::NegMulAdd(a.v, x, hn::Set(Lanes(), 2.0f))));
}
/// At most e^88, which is finite; beyond it hn::Exp may return anything.
HWY_INLINE Float exp_of(Float a) { return Float(hn::Exp(Lanes(), min_of(a, Float(88.0f)).v)); }
HWY_INLINE Float product_of(Float a, Float b) { return a * b; }
HWY_INLINE Float log2_of(Float a) { return Float(hn::Log2(Lanes(), a.v)); }
HWY_INLINE Float select(Bool condition, Float a, Float b) { return Float(hn::IfThenElse(condition.m, a.v, b.v)); }

HWY_INLINE constexpr std::size_t lanes() { return hn::MaxLanes(Lanes()); }

HWY_INLINE Float load(const float* HWY_RESTRICT from) { return Float(hn::LoadU(Lanes(), from)); }
HWY_INLINE void store(Float a, float* HWY_RESTRICT to) { hn::StoreU(a.v, Lanes(), to); }

/// lanes() bytes as floats.
HWY_INLINE Float load_bytes(const std::uint8_t* HWY_RESTRICT from) {
  const Lanes d;
  const hn::Rebind<std::int32_t, Lanes> integers;
  return Float(hn::ConvertTo(d, hn::PromoteTo(integers, hn::LoadU(hn::Rebind<std::uint8_t, Lanes>(), from))));
}

/// load(from + k), given the vectors at `from` and at `from + lanes()`. Where a vector fills a cache line, most such
/// loads would read two lines, so the lanes are taken from the two vectors instead.
template <int k>
HWY_INLINE Float load_after(const float* HWY_RESTRICT from, [[maybe_unused]] Float first,
                            [[maybe_unused]] Float second) {
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
  if constexpr (k == 0) return first;
  static_cast<void>(from);
  const __m512i low = _mm512_castps_si512(first.v.raw), high = _mm512_castps_si512(second.v.raw);
  return Float(Vec{_mm512_castsi512_ps(_mm512_alignr_epi32(high, low, k))});
#else
  return load(from + k);
#endif
}

/// Loads rows of W numbers, one row per lane, as W vectors. Lanes from `count` on repeat the last row.
template <std::size_t W>
HWY_INLINE void load_rows(const float* HWY_RESTRICT rows, std::size_t count, Float (&columns)[W]) {
  alignas(64) float padded[W * lanes()];
  if (count < lanes()) {
    for (std::size_t lane = 0; lane < lanes(); ++lane) {
      std::memcpy(padded + W * lane, rows + W * std::min(lane, count - 1), W * sizeof(float));
    }
    rows = padded;
  }
  const Lanes d;
  if constexpr (W == 1) {
    columns[0].v = hn::LoadU(d, rows);
  } else if constexpr (W == 2) {
    hn::LoadInterleaved2(d, rows, columns[0].v, columns[1].v);
  } else if constexpr (W == 3) {
    hn::LoadInterleaved3(d, rows, columns[0].v, columns[1].v, columns[2].v);
  } else {
    static_assert(W == 4);
    hn::LoadInterleaved4(d, rows, columns[0].v, columns[1].v, columns[2].v, columns[3].v);
  }
}

/// Stores W vectors as `count` rows, or adds them to the rows.
template <std::size_t W>
HWY_INLINE void store_rows(const Float (&columns)[W], std::size_t count, bool add, float* HWY_RESTRICT rows) {
  const Lanes d;
  Float out[W];
  for (std::size_t c = 0; c < W; ++c) out[c] = columns[c];
  if (add) {
    Float before[W];
    load_rows(rows, count, before);
    for (std::size_t c = 0; c < W; ++c) out[c] += before[c];
  }
  alignas(64) float padded[W * lanes()];
  float* to = count < lanes() ? padded : rows;
  if constexpr (W == 1) {
    hn::StoreU(out[0].v, d, to);
  } else if constexpr (W == 2) {
    hn::StoreInterleaved2(out[0].v, out[1].v, d, to);
  } else if constexpr (W == 3) {
    hn::StoreInterleaved3(out[0].v, out[1].v, out[2].v, d, to);
  } else {
    static_assert(W == 4);
    hn::StoreInterleaved4(out[0].v, out[1].v, out[2].v, out[3].v, d, to);
  }
  if (to == padded) std::memcpy(rows, padded, W * count * sizeof(float));
}

#if HWY_TARGET != HWY_SCALAR
/// Transposes a 4×4 matrix of rows.
template <class Four>
HWY_INLINE void transpose4(Four& a, Four& b, Four& c, Four& e) {
  const hn::CappedTag<float, 4> four;
  const hn::RepartitionToWide<hn::RebindToUnsigned<decltype(four)>> pair;
  const auto ac_low = hn::BitCast(pair, hn::InterleaveLower(four, a, b));
  const auto ac_high = hn::BitCast(pair, hn::InterleaveUpper(four, a, b));
  const auto ce_low = hn::BitCast(pair, hn::InterleaveLower(four, c, e));
  const auto ce_high = hn::BitCast(pair, hn::InterleaveUpper(four, c, e));
  a = hn::BitCast(four, hn::InterleaveLower(pair, ac_low, ce_low));
  b = hn::BitCast(four, hn::InterleaveUpper(pair, ac_low, ce_low));
  c = hn::BitCast(four, hn::InterleaveLower(pair, ac_high, ce_high));
  e = hn::BitCast(four, hn::InterleaveUpper(pair, ac_high, ce_high));
}
#endif

/// Loads rows, `stride` apart, into columns [columns, lanes()]. Lanes from `count` on repeat the last row.
HWY_INLINE void rows_to_columns(const float* HWY_RESTRICT rows, std::size_t stride, std::size_t count,
                                std::size_t columns, float* HWY_RESTRICT to) {
  std::size_t column = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::CappedTag<float, 4> four;
  for (; column + 4 <= columns; column += 4) {
    for (std::size_t lane = 0; lane < lanes(); lane += 4) {
      const auto row = [&](std::size_t i)
                           HWY_ATTR { return hn::LoadU(four, rows + stride * std::min(lane + i, count - 1) + column); };
      auto a = row(0), b = row(1), c = row(2), e = row(3);
      transpose4(a, b, c, e);
      float* const corner = to + column * lanes() + lane;
      hn::Store(a, four, corner);
      hn::Store(b, four, corner + lanes());
      hn::Store(c, four, corner + 2 * lanes());
      hn::Store(e, four, corner + 3 * lanes());
    }
  }
#endif
  for (; column < columns; ++column) {
    for (std::size_t lane = 0; lane < lanes(); ++lane) {
      to[column * lanes() + lane] = rows[stride * std::min(lane, count - 1) + column];
    }
  }
}

/// Writes columns [columns, lanes()] to `count` rows, `stride` apart, or adds them to the rows.
HWY_INLINE void columns_to_rows(const float* HWY_RESTRICT from, std::size_t columns, std::size_t count, bool add,
                                float* HWY_RESTRICT rows, std::size_t stride) {
  std::size_t column = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::CappedTag<float, 4> four;
  for (; column + 4 <= columns; column += 4) {
    for (std::size_t lane = 0; lane < count; lane += 4) {
      const float* const corner = from + column * lanes() + lane;
      auto a = hn::Load(four, corner), b = hn::Load(four, corner + lanes());
      auto c = hn::Load(four, corner + 2 * lanes()), e = hn::Load(four, corner + 3 * lanes());
      transpose4(a, b, c, e);
      const auto put = [&](std::size_t i, decltype(a) row) HWY_ATTR {
        if (lane + i >= count) return;
        float* const to = rows + stride * (lane + i) + column;
        hn::StoreU(add ? hn::Add(row, hn::LoadU(four, to)) : row, four, to);
      };
      put(0, a);
      put(1, b);
      put(2, c);
      put(3, e);
    }
  }
#endif
  for (; column < columns; ++column) {
    for (std::size_t lane = 0; lane < count; ++lane) {
      float& to = rows[stride * lane + column];
      to = add ? to + from[column * lanes() + lane] : from[column * lanes() + lane];
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
