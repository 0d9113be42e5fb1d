// SPDX-License-Identifier: Apache-2.0
/// @file A tile of pixels as rows of vectors, and the blending step of a row given a primitive's α: shared by blending,
/// its gradient and the count replay, for all kinds of primitives.
///
/// Compiled once per instruction set (Highway's per-target include), hence no ordinary include guard.

#if defined(SPLATBOOST_TILE_ROWS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_TILE_ROWS_INL_H_
#undef SPLATBOOST_TILE_ROWS_INL_H_
#else
#define SPLATBOOST_TILE_ROWS_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>

#include <hwy/highway.h>

#include "device/lanes-inl.h"
#include "projection/tile_lists.h"
#include "splatboost/constants.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {
inline constexpr int kPixels = kTileSize * kTileSize;
/// Rows are processed two at a time; after the tile's last row comes one whose pixels are closed.
inline constexpr int kSpareRow = kTileSize;
/// Entries of a tile that are processed together: the rows of all of them are found before any branch on them.
inline constexpr std::uint32_t kBatch = 32;
/// Maximum number of blocks of columns in a tile.
inline constexpr int kMaxBlocks = kTileSize;

HWY_INLINE std::size_t blocks_of_columns() { return kTileSize / hn::Lanes(Lanes()); }

/// 2^x for x in [-126, 127], unspecified elsewhere; polynomial fit at Chebyshev nodes on [-½, ½], relative error 1e-7.
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

/// Sum over the lanes.
HWY_INLINE float sum_of(Vec v) { return hn::GetLane(hn::SumOfLanes(Lanes(), v)); }

/// Sums over the lanes of four vectors at once, half the work of four separate sums: the vectors are interleaved into
/// one in which every 128-bit block holds a partial sum of each, and the blocks are added.
HWY_INLINE void sums_of(Vec a, Vec b, Vec c, Vec e, float* HWY_RESTRICT sums) {
#if HWY_TARGET == HWY_SCALAR
  sums[0] = sum_of(a);
  sums[1] = sum_of(b);
  sums[2] = sum_of(c);
  sums[3] = sum_of(e);
#else
  const Lanes d;
  const hn::Repartition<std::uint64_t, Lanes> wide;
  const Vec ab = hn::Add(hn::InterleaveLower(d, a, b), hn::InterleaveUpper(d, a, b));
  const Vec ce = hn::Add(hn::InterleaveLower(d, c, e), hn::InterleaveUpper(d, c, e));
  const auto ab2 = hn::BitCast(wide, ab), ce2 = hn::BitCast(wide, ce);
  const Vec blocks =
      hn::Add(hn::BitCast(d, hn::InterleaveLower(wide, ab2, ce2)), hn::BitCast(d, hn::InterleaveUpper(wide, ab2, ce2)));
  alignas(64) float parts[kTileSize];
  hn::Store(blocks, d, parts);
  const hn::CappedTag<float, 4> four;
  auto sum = hn::Load(four, parts);
  for (std::size_t i = 4; i < hn::Lanes(d); i += 4) sum = hn::Add(sum, hn::Load(four, parts + i));
  hn::StoreU(sum, four, sums);
#endif
}

/// First and last row of a mask, which must not be empty. Rows in between that are not in the mask are closed, so that
/// processing them changes nothing; nor does processing the row after the last.
struct RowRange {
  int first, last;
  HWY_INLINE explicit RowRange(std::uint32_t mask) : first(std::countr_zero(mask)), last(31 - std::countl_zero(mask)) {}
};

/// Effect of one primitive on one row of pixels.
struct RowStep {
  Vec dy;
  Vec alpha;   ///< 0 where it is below the threshold
  Vec before;  ///< transmittance before the primitive
  Vec after;   ///< ... and behind it, where it is blended
  Mask open;   ///< pixels that are open afterwards; the primitive was blended where their α is not 0
};

/// Advances a row of transmittances past a primitive; fills in all of `step` but dy and alpha. A pixel that the
/// primitive would saturate is closed without blending it: it keeps its transmittance with a negative sign, which fails
/// the comparison for every later primitive.
HWY_INLINE void pass_row(RowStep& step, float* HWY_RESTRICT transmittance) {
  const Lanes d;
  step.before = hn::Load(d, transmittance);
  step.after = hn::NegMulAdd(step.before, step.alpha, step.before);
  step.open = hn::Ge(step.after, hn::Set(d, kMinTransmittance));
  hn::Store(hn::IfThenElse(step.open, step.after, hn::Or(step.before, hn::SignBit(d))), d, transmittance);
}

/// The part of a tile's state that the loops over rows read and write. Data used together is stored together: a row's
/// transmittance, then its other planes. Separate planes would have addresses with equal low bits, and a load whose low
/// address bits match those of a pending store waits for it.
/// @tparam kPlanes planes of a row, the transmittance included
template <int kPlanes>
struct TileRows {
  static constexpr int kStride = kPlanes * kTileSize;
  alignas(64) float rows[(kTileSize + 1) * kStride];
  int x0, y0;
  float first_y;  ///< pixel centre of the first row

  /// Sets transmittances to 1, closes the pixels outside the image, and sets the other planes to zero.
  TileRows(const TileLists& lists, std::size_t tile) {
    x0 = static_cast<int>(tile % static_cast<std::size_t>(lists.tiles_x)) * kTileSize;
    y0 = static_cast<int>(tile / static_cast<std::size_t>(lists.tiles_x)) * kTileSize;
    first_y = static_cast<float>(y0) + 0.5f;
    const int width = std::min(lists.camera.width - x0, kTileSize);
    const int height = std::min(lists.camera.height - y0, kTileSize);
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

/// Fills plane 1 with the flags of a tile's pixels.
/// @param flagged [256] 1 or 0
/// @param rows [blocks of columns] all 0; receives the rows of each block that hold a flag, as a bit mask
template <int kPlanes>
HWY_INLINE void load_flags(const float* HWY_RESTRICT flagged, TileRows<kPlanes>& pixels, std::uint32_t* rows) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int pixel = 0; pixel < kPixels; pixel += lanes) {
    const int row = pixel / kTileSize, x = pixel % kTileSize;
    const Vec flags = hn::Load(d, flagged + pixel);
    hn::Store(flags, d, pixels.at(row, x, 1));
    const bool any = !hn::AllFalse(d, hn::Gt(flags, hn::Zero(d)));
    rows[x / lanes] |= static_cast<std::uint32_t>(any) << row;
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
