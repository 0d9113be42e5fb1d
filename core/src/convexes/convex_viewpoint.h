// SPDX-License-Identifier: Apache-2.0
/// @file View parameters for the projection of convexes.
#pragma once

#include "projection/projection_camera.h"
#include "splatboost/convex_rasterizer.h"

namespace splatboost {

/// Parameters shared by all convexes of a view.
struct ConvexViewpoint {
  ProjectionCamera camera;
  int width, height, tiles_x, tiles_y;
  bool square;
  float beta, near_plane, pixel_area;
  bool released_view_direction;
};

inline ConvexViewpoint make_viewpoint(const Camera& camera, const ConvexOptions& options) {
  return {make_projection_camera(camera),
          camera.width,
          camera.height,
          camera.tiles_x(),
          camera.tiles_y(),
          options.box == ConvexBox::square,
          options.beta,
          options.near_plane,
          options.pixel_size * options.pixel_size,
          options.released_view_direction};
}

/// Offset of the edges with which a record's arrays are padded: their terms are below those of any edge of a hull.
inline constexpr float kNeverNear = -1e30f;

}  // namespace splatboost
