// SPDX-License-Identifier: Apache-2.0
/// @file Which tiles a splat is listed in: the 3σ square of 3DGS, and the ellipse of the compact box (paper eq. 15).
/// T is a number type (see host_device.h); tile indices are integral values of that type.

#if defined(SPLATBOOST_TILE_MATH_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_TILE_MATH_H_
#undef SPLATBOOST_TILE_MATH_H_
#else
#define SPLATBOOST_TILE_MATH_H_
#endif

#include "device/host_device.h"
#include "projection/vector_math.h"
#include "splatboost/constants.h"

SPLATBOOST_MATH_BEGIN

/// Half-open range of tiles.
template <class T>
struct TileRange {
  T begin, end;
};

template <class T>
SPLATBOOST_HOST_DEVICE T clamp_tile(T tile, int tiles) {
  return min_of(max_of(tile, T(0.0f)), T(static_cast<float>(tiles)));
}

/// 3DGS's radius: 3σ of the longer axis, rounded up.
template <class T>
SPLATBOOST_HOST_DEVICE T square_radius(const Symmetric2<T>& covariance) {
  const T mid = T(0.5f) * (covariance.xx + covariance.yy);
  const T det = covariance.xx * covariance.yy - covariance.xy * covariance.xy;
  return ceil_of(T(kBoxSigmas) * sqrt_of(mid + sqrt_of(max_of(mid * mid - det, T(0.1f)))));
}

/// Tiles along one axis that the square [centre ± radius] meets, in 3DGS's pixel coordinates (centres at integers).
template <class T>
SPLATBOOST_HOST_DEVICE TileRange<T> square_tiles(T mean, T radius, int tiles) {
  const T centre = mean - T(0.5f);
  const T per_tile(1.0f / kTileSize);  // a power of two: exact
  return {clamp_tile(floor_of((centre - radius) * per_tile), tiles),
          clamp_tile(floor_of((centre + radius + T(kTileSize - 1)) * per_tile), tiles)};
}

/// Tiles t along one axis whose interval of pixel centres [16t + 0.5, 16t + 15.5] meets [low, high].
template <class T>
SPLATBOOST_HOST_DEVICE TileRange<T> tiles_meeting(T low, T high, int tiles) {
  const T per_tile(1.0f / kTileSize);
  return {clamp_tile(ceil_of((low - T(kTileSize - 0.5f)) * per_tile), tiles),
          clamp_tile(floor_of((high - T(0.5f)) * per_tile) + T(1.0f), tiles)};
}

/// The ellipse dᵀ·conic·d <= t around a mean; t > 0.
template <class T>
struct Ellipse {
  Vec2<T> mean;
  Symmetric2<T> conic;
  T t;
  T half_width, half_height;  ///< of its bounding box
};

template <class T>
SPLATBOOST_HOST_DEVICE Ellipse<T> make_ellipse(Vec2<T> mean, const Symmetric2<T>& covariance,
                                               const Symmetric2<T>& conic, T t) {
  return {mean, conic, t, sqrt_of(t * covariance.xx), sqrt_of(t * covariance.yy)};
}

/// Pixels by which an ellipse is widened, so that rounding never loses a tile. Listing an extra tile is harmless.
SPLATBOOST_HOST_DEVICE constexpr float tile_slack() { return 1e-3f; }

template <class T>
SPLATBOOST_HOST_DEVICE TileRange<T> ellipse_tile_rows(const Ellipse<T>& e, int tiles_y) {
  const T half = e.half_height + T(tile_slack());
  return tiles_meeting(e.mean.y - half, e.mean.y + half, tiles_y);
}

template <class T>
SPLATBOOST_HOST_DEVICE TileRange<T> ellipse_tile_columns(const Ellipse<T>& e, int tiles_x) {
  const T half = e.half_width + T(tile_slack());
  return tiles_meeting(e.mean.x - half, e.mean.x + half, tiles_x);
}

/// Tiles of one tile row that the ellipse meets. Exact: the part of an ellipse within the row's band is convex, so its
/// extent in x is one interval. All callers must find the same tiles, so no product is fused with a sum.
template <class T>
SPLATBOOST_HOST_DEVICE TileRange<T> ellipse_tiles_in_row(const Ellipse<T>& e, T row, int tiles_x) {
  const T top = row * T(kTileSize) - e.mean.y;
  const T y0 = max_of(top + T(0.5f), -e.half_height);
  const T y1 = min_of(top + T(kTileSize - 0.5f), e.half_height);
  const T a = e.conic.xx, b = e.conic.xy, c = e.conic.yy;
  const T det = product_of(a, c) - product_of(b, b);
  const T inverse_a = T(1.0f) / a;
  // y at which the ellipse is rightmost (leftmost: the negative), clamped to the band.
  const T y_right = -b / c * e.half_width;
  const T at_right = min_of(max_of(y_right, y0), y1);
  const T at_left = min_of(max_of(-y_right, y0), y1);
  const T a_t = product_of(a, e.t);
  const T chord_right = sqrt_of(max_of(a_t - product_of(product_of(det, at_right), at_right), T(0.0f)));
  const T chord_left = sqrt_of(max_of(a_t - product_of(product_of(det, at_left), at_left), T(0.0f)));
  const T right = product_of(chord_right - product_of(b, at_right), inverse_a);
  const T left = -product_of(chord_left + product_of(b, at_left), inverse_a);
  return tiles_meeting(e.mean.x + left - T(tile_slack()), e.mean.x + right + T(tile_slack()), tiles_x);
}

SPLATBOOST_MATH_END

#endif  // guard
