// SPDX-License-Identifier: Apache-2.0
/// @file Projection of one convex from its parameters to the record that blending reads and the tiles that list it, and
/// its gradient, for one thread of a GPU. On the CPU, project_convexes_cpu.cpp processes blocks of convexes.
#pragma once

#include "convexes/convex_frame.h"
#include "convexes/convex_math.h"
#include "convexes/convex_viewpoint.h"
#include "projection/sh_math.h"
#include "projection/tile_math.h"

namespace splatboost {

/// Parameters of one convex, rows of Convexes.
struct ConvexRows {
  const float* points;  ///< [K,3]
  int count;            ///< K
  float smoothness, sharpness, opacity;
  const float* color;    ///< [3]; null: from spherical harmonics
  const float* sh_dc;    ///< [3]
  const float* sh_rest;  ///< [rows,3]
  int sh_degree;
};

/// The tiles that list a convex.
struct ConvexTiles {
  bool square = false;
  float centre_x = 0.0f, centre_y = 0.0f, radius = 0.0f;  ///< of the square, px
  ConvexFootprint footprint;                              ///< if not square
};

/// Calls visit(row, begin, end) for the tiles [begin, end) of each row of tiles.
template <class Visit>
SPLATBOOST_HOST_DEVICE void for_tile_rows(const ConvexTiles& tiles, const ConvexViewpoint& view, const Visit& visit) {
  if (tiles.square) {
    const auto x = square_tiles(tiles.centre_x, tiles.radius, view.tiles_x);
    const auto y = square_tiles(tiles.centre_y, tiles.radius, view.tiles_y);
    for (int row = static_cast<int>(y.begin); row < static_cast<int>(y.end); ++row) {
      visit(row, static_cast<int>(x.begin), static_cast<int>(x.end));
    }
    return;
  }
  if (tiles.footprint.corners == 0) return;
  const Extent height = height_of(tiles.footprint);
  const auto y = tiles_meeting(height.low, height.high, view.tiles_y);
  for (int row = static_cast<int>(y.begin); row < static_cast<int>(y.end); ++row) {
    const float top = static_cast<float>(row * kTileSize) + 0.5f;
    const Extent width = width_within(tiles.footprint, top, top + (kTileSize - 1));
    const auto x = tiles_meeting(width.low, width.high, view.tiles_x);
    visit(row, static_cast<int>(x.begin), static_cast<int>(x.end));
  }
}

/// Direction from the camera to a convex, unit, and the reciprocal of the distance.
struct ConvexRay {
  Vec3<float> direction;
  float inverse_length;
};

SPLATBOOST_HOST_DEVICE ConvexRay ray_to(const ConvexRows& convex, const ConvexViewpoint& view) {
  float centre[3] = {0.0f, 0.0f, 0.0f};
  for (int k = 0; k < 3 * convex.count; ++k) centre[k % 3] += convex.points[k];
  for (int c = 0; c < 3; ++c) centre[c] /= static_cast<float>(convex.count);
  if (view.released_view_direction) centre[0] = centre[1] = centre[2];
  const float* const eye = view.camera.centre;
  const Vec3<float> ray{centre[0] - eye[0], centre[1] - eye[1], centre[2] - eye[2]};
  const float inverse_length = 1.0f / sqrt_of(dot(ray, ray));
  return {inverse_length * ray, inverse_length};
}

SPLATBOOST_HOST_DEVICE void color_of(const ConvexRows& convex, const ConvexViewpoint& view, float (&color)[3]) {
  if (convex.color != nullptr) {
    for (int c = 0; c < 3; ++c) color[c] = convex.color[c];
    return;
  }
  float basis[kMaxShCoefficients];
  sh_basis(convex.sh_degree, ray_to(convex, view).direction, basis);
  for (int c = 0; c < 3; ++c) color[c] = 0.5f + basis[0] * convex.sh_dc[c];
  for (int k = 1; k < sh_coefficients(convex.sh_degree); ++k) {
    for (int c = 0; c < 3; ++c) color[c] += basis[k] * convex.sh_rest[3 * (k - 1) + c];
  }
  for (int c = 0; c < 3; ++c) color[c] = max_of(color[c], 0.0f);
}

/// @return whether the convex may be drawn; otherwise the record and the tiles are unspecified
SPLATBOOST_HOST_DEVICE bool make_record(const ConvexRows& convex, const ConvexViewpoint& view, ConvexRecord& record,
                                        ConvexTiles& tiles) {
  if (!(convex.opacity > kMinAlpha)) return false;
  ProjectedConvex p;
  if (!project_convex(view.camera, convex.points, convex.count, view.near_plane, p)) return false;
  const float scale = p.depth * convex.smoothness * view.pixel_area;
  const float steepness = p.depth * convex.sharpness;
  if (!(scale > 0.0f && scale < 1e30f && steepness > 0.0f && steepness < 1e30f)) return false;
  const float farthest = farthest_of(convex.opacity, steepness);
  tiles.square = view.square;
  if (view.square) {
    tiles.centre_x = p.centre_x;
    tiles.centre_y = p.centre_y;
    tiles.radius = released_radius(p, 2.1f / (scale * steepness));
    if (tiles.radius <= 0.0f) return false;
  } else {
    // If farthest <= 0, α reaches 1/255 only inside the hull; then β must not scale the bound.
    const float reach = farthest > 0.0f ? view.beta * farthest : farthest;
    find_footprint(p, scale, reach, view.width, view.height, tiles.footprint);
    if (tiles.footprint.corners == 0) return false;
  }
  record.centre_x = p.centre_x;
  record.centre_y = p.centre_y;
  record.depth = p.depth;
  record.steepness = steepness;
  record.opacity = convex.opacity;
  record.farthest = kLog2E * (farthest + 1e-4f * abs_of(farthest));
  float color[3];
  color_of(convex, view, color);
  record.red = color[0];
  record.green = color[1];
  record.blue = color[2];
  record.edges = static_cast<std::uint32_t>(p.edges);
  for (int k = 0; k < kMaxConvexPoints; ++k) {
    const HullEdge edge = k < p.edges ? hull_edge(p, k) : HullEdge{0.0f, 0.0f, 0.0f};
    record.hull[k] = k < p.edges ? p.hull[k] : std::uint8_t{0};
    record.edge_x[k] = kLog2E * scale * edge.x;
    record.edge_y[k] = kLog2E * scale * edge.y;
    record.edge_offset[k] = k < p.edges ? kLog2E * scale * edge.offset : kNeverNear;
  }
  return true;
}

/// Gradients of one convex: of its geometry, and of its rows of the other parameters.
struct ConvexRowGradients {
  ConvexGeometryGradient geometry;
  float opacity;
  float color[3];                      ///< of the colour towards the camera; 0 where it was clamped, unless it is given
  float sh_basis[kMaxShCoefficients];  ///< times color: gradients of the harmonics' coefficients
  float view_sharpness_abs;
};

/// @param total sums of the convex's moments over its tiles
SPLATBOOST_HOST_DEVICE void find_gradients(const ConvexRows& convex, const ConvexViewpoint& view,
                                           const ConvexRecord& record, const ConvexMoments& total,
                                           ConvexRowGradients& g) {
  ProjectedConvex p;
  place_points(view.camera, convex.points, convex.count, view.near_plane, p);
  p.edges = static_cast<int>(record.edges);  // the hull of the forward pass: rounding might give another one now
  for (int k = 0; k < p.edges; ++k) p.hull[k] = record.hull[k];
  ConvexSums sums;
  sums.opacity = total.s;
  sums.steepness = kLn2 * total.steepness;
  for (int k = 0; k < p.edges; ++k) {
    for (int m = 0; m < 3; ++m) sums.edge[k][m] = record.steepness * total.edge[k][m];
  }
  project_convex_backward(view.camera, p, convex.count, convex.smoothness, convex.sharpness, view.pixel_area, sums,
                          g.geometry);
  g.opacity = sums.opacity / record.opacity;  // dα/do = α/o
  g.view_sharpness_abs = p.depth * kLn2 * total.steepness_abs;
  g.color[0] = total.red;
  g.color[1] = total.green;
  g.color[2] = total.blue;
  if (convex.color != nullptr) return;
  // No gradient where the colour was clamped at zero.
  if (!(record.red > 0.0f)) g.color[0] = 0.0f;
  if (!(record.green > 0.0f)) g.color[1] = 0.0f;
  if (!(record.blue > 0.0f)) g.color[2] = 0.0f;
  const ConvexRay ray = ray_to(convex, view);
  sh_basis(convex.sh_degree, ray.direction, g.sh_basis);
  if (convex.sh_degree == 0) return;
  float weights[kMaxShCoefficients] = {};
  for (int k = 1; k < sh_coefficients(convex.sh_degree); ++k) {
    for (int c = 0; c < 3; ++c) weights[k] += convex.sh_rest[3 * (k - 1) + c] * g.color[c];
  }
  const Vec3<float> of_centre =
      through_normalise(ray.direction, ray.inverse_length, sh_basis_gradient(convex.sh_degree, ray.direction, weights));
  const float share = 1.0f / static_cast<float>(convex.count);
  for (int k = 0; k < convex.count; ++k) {
    g.geometry.points[k][0] += share * of_centre.x;
    g.geometry.points[k][1] += share * of_centre.y;
    g.geometry.points[k][2] += share * of_centre.z;
  }
}

}  // namespace splatboost
