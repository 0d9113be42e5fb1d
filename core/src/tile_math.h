// SPDX-License-Identifier: Apache-2.0
/// @file Which tiles a splat is listed in: the 3σ square of 3DGS, and the ellipse of the compact box (paper eq. 15).
#pragma once

#include <cmath>

#include <glm/vec2.hpp>

#include "host_device.h"
#include "project_math.h"
#include "splatboost/constants.h"

namespace splatboost {

/// Half-open ranges of tiles.
struct TileRange {
  int begin = 0;
  int end = 0;
};

SPLATBOOST_HOST_DEVICE int clamp_tile(float tile, int tiles) {
  // In float first: far-off splats overflow an int.
  return static_cast<int>(min_of(max_of(tile, 0.0f), static_cast<float>(tiles)));
}

/// 3DGS's radius: 3σ of the longer axis, rounded up.
SPLATBOOST_HOST_DEVICE float square_radius(const Symmetric2& covariance) {
  const float mid = 0.5f * (covariance.xx + covariance.yy);
  const float det = covariance.xx * covariance.yy - covariance.xy * covariance.xy;
  return ceilf(kBoxSigmas * sqrtf(mid + sqrtf(max_of(0.1f, mid * mid - det))));
}

/// Tiles of one axis that the square [centre ± radius] meets, centre in 3DGS's pixel coordinates (centres at integers).
SPLATBOOST_HOST_DEVICE TileRange square_tiles(float mean, float radius, int tiles) {
  const float centre = mean - 0.5f;
  return {clamp_tile(floorf((centre - radius) / kTileSize), tiles),
          clamp_tile(floorf((centre + radius + kTileSize - 1) / kTileSize), tiles)};
}

/// Slack in pixels by which an ellipse is widened, so that rounding never loses a tile. Listing one too many is
/// harmless.
inline constexpr float kTileSlack = 1e-3f;

/// Tiles whose pixel centres' interval [16t + 0.5, 16t + 15.5] meets [low, high].
SPLATBOOST_HOST_DEVICE TileRange tiles_meeting(float low, float high, int tiles) {
  constexpr float kLastCentre = kTileSize - 0.5f;
  const int begin = clamp_tile(ceilf((low - kLastCentre) / kTileSize), tiles);
  const int end = clamp_tile(floorf((high - 0.5f) / kTileSize) + 1.0f, tiles);
  return {begin, end};
}

/// The ellipse dᵀ·conic·d <= t around a mean; t > 0.
struct Ellipse {
  glm::vec2 mean;
  Symmetric2 conic;
  float t;
  float half_width, half_height;  ///< of its bounding box
};

SPLATBOOST_HOST_DEVICE Ellipse make_ellipse(glm::vec2 mean, const Symmetric2& covariance, const Symmetric2& conic,
                                            float t) {
  return {mean, conic, t, sqrtf(t * covariance.xx), sqrtf(t * covariance.yy)};
}

SPLATBOOST_HOST_DEVICE TileRange ellipse_tile_rows(const Ellipse& e, int tiles_y) {
  return tiles_meeting(e.mean.y - e.half_height - kTileSlack, e.mean.y + e.half_height + kTileSlack, tiles_y);
}

/// Tiles of one tile row that the ellipse meets: exact, because the part of a convex shape within the row's band is
/// convex, so its extent in x is one interval.
SPLATBOOST_HOST_DEVICE TileRange ellipse_tiles_in_row(const Ellipse& e, int row, int tiles_x) {
  const float y0 = max_of(static_cast<float>(row * kTileSize) + 0.5f - e.mean.y, -e.half_height);
  const float y1 = min_of(static_cast<float>((row + 1) * kTileSize) - 0.5f - e.mean.y, e.half_height);
  const float a = e.conic.xx, b = e.conic.xy, c = e.conic.yy;
  const float det = a * c - b * b;
  // Height at which the ellipse is rightmost (leftmost: its negative), brought into the band.
  const float y_right = -b / c * e.half_width;
  const float at_right = min_of(max_of(y_right, y0), y1);
  const float at_left = min_of(max_of(-y_right, y0), y1);
  const float right = (-b * at_right + sqrtf(max_of(0.0f, a * e.t - det * at_right * at_right))) / a;
  const float left = (-b * at_left - sqrtf(max_of(0.0f, a * e.t - det * at_left * at_left))) / a;
  return tiles_meeting(e.mean.x + left - kTileSlack, e.mean.x + right + kTileSlack, tiles_x);
}

}  // namespace splatboost
