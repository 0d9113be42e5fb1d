// SPDX-License-Identifier: Apache-2.0
/// @file Projection of one convex to the edges of its hull on the screen, its gradient, and the tiles that the convex
/// may reach: for one thread of a GPU. convex_blocks-inl.h has the same for the vector lanes of a CPU.
///
/// Structs with arrays are filled through references, not returned: nvcc 13.0 gave the caller's copy of a returned
/// ProjectedConvex the memory of an array that was written while the copy was still read.
#pragma once

#include <cmath>
#include <cstdint>

#include "device/host_device.h"
#include "projection/projection_camera.h"
#include "splatboost/constants.h"
#include "splatboost/convex_rasterizer.h"

namespace splatboost {

inline constexpr float kLog2E = 1.4426950408889634f;
inline constexpr float kLn2 = 0.6931471805599453f;

/// A convex on the screen.
struct ProjectedConvex {
  float depth;                      ///< of the centre
  float centre_x, centre_y;         ///< px; points are relative to it
  float x[kMaxConvexPoints];        ///< px
  float y[kMaxConvexPoints];        ///< px
  float view[kMaxConvexPoints][3];  ///< in the camera frame
  int edges;                        ///< of the hull
  /// Vertices of the hull: edge k goes from hull[k] to hull[(k + 1) % edges], with the interior to its left if y
  /// points up.
  std::uint8_t hull[kMaxConvexPoints];
};

/// Sine of the angle up to which two directions from a vertex count as equal. Rounding moves projected points by about
/// 1e-7 of a convex's size: without this tolerance, whether a point on an edge is a vertex would depend on the
/// instruction set. An edge's weight in φ is its length, so an additional vertex changes the image.
inline constexpr float kStraight = 1e-5f;

/// Whether the path from a over b to c turns left if y points up, by more than rounding errors.
SPLATBOOST_HOST_DEVICE bool turns_left(const ProjectedConvex& p, int a, int b, int c) {
  const float b_x = p.x[b] - p.x[a], b_y = p.y[b] - p.y[a], c_x = p.x[c] - p.x[a], c_y = p.y[c] - p.y[a];
  const float turn = b_x * c_y - b_y * c_x;
  return turn > 0.0f && turn * turn > kStraight * kStraight * ((b_x * b_x + b_y * b_y) * (c_x * c_x + c_y * c_y));
}

/// Convex hull by Andrew's monotone chain; fewer than three vertices if all points lie on a line.
SPLATBOOST_HOST_DEVICE void find_hull(ProjectedConvex& p, int points) {
  std::uint8_t order[kMaxConvexPoints];
  for (int i = 0; i < points; ++i) {
    int at = i;
    for (; at > 0; --at) {
      const int before = order[at - 1];
      if (p.x[before] < p.x[i] || (p.x[before] == p.x[i] && p.y[before] <= p.y[i])) break;
      order[at] = order[at - 1];
    }
    order[at] = static_cast<std::uint8_t>(i);
  }
  std::uint8_t chain[2 * kMaxConvexPoints];
  int n = 0;
  for (int i = 0; i < points; ++i) {
    while (n >= 2 && !turns_left(p, chain[n - 2], chain[n - 1], order[i])) --n;
    chain[n++] = order[i];
  }
  const int lower = n + 1;
  for (int i = points - 2; i >= 0; --i) {
    while (n >= lower && !turns_left(p, chain[n - 2], chain[n - 1], order[i])) --n;
    chain[n++] = order[i];
  }
  p.edges = n - 1;  // the first vertex was added again
  for (int k = 0; k < p.edges && k < kMaxConvexPoints; ++k) p.hull[k] = chain[k];
}

/// Sets all of p except the hull: the points of a convex in the camera frame and on the screen.
/// @param points [K,3] world
/// @return whether the convex may be drawn. p is set in either case: the backward pass must not repeat this decision,
/// which might differ from that of the forward pass.
SPLATBOOST_HOST_DEVICE bool place_points(const ProjectionCamera& camera, const float* points, int count,
                                         float near_plane, ProjectedConvex& p) {
  const float share = 1.0f / static_cast<float>(count);
  float mean[3] = {0.0f, 0.0f, 0.0f};
  for (int i = 0; i < 3 * count; ++i) mean[i % 3] += share * points[i];
  const float* const axes[3] = {camera.axis_x, camera.axis_y, camera.axis_z};
  float centre[3];
  for (int c = 0; c < 3; ++c) {
    centre[c] = axes[c][0] * mean[0] + axes[c][1] * mean[1] + axes[c][2] * mean[2] + camera.translation[c];
  }
  p.depth = centre[2];
  const float slope_x = centre[0] / centre[2], slope_y = centre[1] / centre[2];
  p.centre_x = camera.fx * slope_x + camera.cx;
  p.centre_y = camera.fy * slope_y + camera.cy;
  bool valid = p.depth > near_plane && p.depth < 1e30f && abs_of(p.centre_x) < 1e9f && abs_of(p.centre_y) < 1e9f;
  for (int i = 0; i < count; ++i) {
    // Computed from differences to the centre, so that small shapes keep their precision.
    const float* const w = points + 3 * i;
    const float d[3] = {w[0] - mean[0], w[1] - mean[1], w[2] - mean[2]};
    float away[3];
    for (int c = 0; c < 3; ++c) {
      away[c] = axes[c][0] * d[0] + axes[c][1] * d[1] + axes[c][2] * d[2];
      p.view[i][c] = centre[c] + away[c];
    }
    const float inverse = 1.0f / p.view[i][2];
    p.x[i] = camera.fx * (away[0] - slope_x * away[2]) * inverse;
    p.y[i] = camera.fy * (away[1] - slope_y * away[2]) * inverse;
    // Numbers that are not finite fail a comparison.
    valid = valid && p.view[i][2] > 0.0f && p.x[i] * p.x[i] + p.y[i] * p.y[i] < kMaxConvexReach * kMaxConvexReach;
  }
  return valid;
}

/// place_points(), and the hull.
/// @return whether the convex may be drawn; not if its hull has fewer than three vertices
SPLATBOOST_HOST_DEVICE bool project_convex(const ProjectionCamera& camera, const float* points, int count,
                                           float near_plane, ProjectedConvex& p) {
  if (!place_points(camera, points, count, near_plane, p)) return false;
  find_hull(p, count);
  return p.edges >= 3 && p.edges <= kMaxConvexPoints;
}

/// A hull's edge: L(q) = x·(q_x − centre) + y·(q_y − centre) + offset, px², below 0 inside.
struct HullEdge {
  float x, y, offset;
};

SPLATBOOST_HOST_DEVICE HullEdge hull_edge(const ProjectedConvex& p, int k) {
  const int a = p.hull[k], b = p.hull[k + 1 < p.edges ? k + 1 : 0];
  const float x = p.y[b] - p.y[a], y = p.x[a] - p.x[b];
  return {x, y, -(x * p.x[a] + y * p.y[a])};
}

/// Greatest φ at which α reaches 1/255, given z·σ: opacity / (1 + exp(zσφ)) >= 1/255. The opacity is above 1/255.
SPLATBOOST_HOST_DEVICE float farthest_of(float opacity, float steepness) {
  return kLn2 * log2_of(opacity / kMinAlpha - 1.0f) / steepness;
}

/// Half the side of the square around the centre as in the released code, px; 0 where that draws nothing. Edges are
/// moved outwards by 2.1/(z²δσ), where I = 0.109; the result is the mean distance of the resulting corners, but at
/// least 1.1 times that of the farthest vertex, rounded up.
/// @param margin 2.1/(z²δσ), px²
SPLATBOOST_HOST_DEVICE float released_radius(const ProjectedConvex& p, float margin) {
  float farthest = 0.0f;
  for (int k = 0; k < p.edges; ++k) {
    const float x = p.x[p.hull[k]], y = p.y[p.hull[k]];
    farthest = max_of(farthest, x * x + y * y);
  }
  float sum = 0.0f;
  int corners = 0;
  HullEdge before = hull_edge(p, p.edges - 1);
  for (int k = 0; k < p.edges; ++k) {
    const HullEdge edge = hull_edge(p, k);
    const float cross = before.x * edge.y - before.y * edge.x, dot = before.x * edge.x + before.y * edge.y;
    const float angle = atan2f(abs_of(cross), dot);
    if (angle > 0.1f && angle < 3.0f) {
      const float a = margin - before.offset, b = margin - edge.offset;
      const float x = (a * edge.y - b * before.y) / cross, y = (b * before.x - a * edge.x) / cross;
      sum += sqrt_of(x * x + y * y);
      ++corners;
    }
    before = edge;
  }
  if (corners == 0) return 0.0f;
  const float radius = ceil_of(max_of(1.1f * sqrt_of(farthest), sum / static_cast<float>(corners)));
  return radius < 1e9f ? radius : 0.0f;
}

/// The part of the image that a convex may reach: a convex polygon, px.
struct ConvexFootprint {
  static constexpr int kCapacity = 4 + kMaxConvexPoints;  ///< each edge that cuts adds at most one corner
  float x[kCapacity], y[kCapacity];
  int corners;
};

/// Margin by which a footprint is widened, px, so that rounding never loses a pixel. Listing one too many is harmless.
inline constexpr float kFootprintSlack = 0.05f;

/// Clips the image by each edge of the hull, moved outwards to z·δ·L = farthest: {q: max_k z·δ·L_k(q) <= farthest}
/// contains every pixel where α reaches 1/255, because φ >= max_k z·δ·L_k.
/// @param scale z·δ·pixel_size²
SPLATBOOST_HOST_DEVICE void find_footprint(const ProjectedConvex& p, float scale, float farthest, int width, int height,
                                           ConvexFootprint& footprint) {
  const float left = 0.5f - kFootprintSlack - p.centre_x,
              right = left + static_cast<float>(width - 1) + 2 * kFootprintSlack;
  const float top = 0.5f - kFootprintSlack - p.centre_y,
              bottom = top + static_cast<float>(height - 1) + 2 * kFootprintSlack;
  ConvexFootprint polygons[2];  // each edge cuts one into the other
  ConvexFootprint& image = polygons[0];
  image.x[0] = left, image.y[0] = top;
  image.x[1] = right, image.y[1] = top;
  image.x[2] = right, image.y[2] = bottom;
  image.x[3] = left, image.y[3] = bottom;
  image.corners = 4;
  const float moved = (farthest + 1e-4f * abs_of(farthest)) / scale;
  int last = 0;
  for (int k = 0; k < p.edges && polygons[last].corners > 0; ++k) {
    const ConvexFootprint& f = polygons[last];
    ConvexFootprint& cut = polygons[1 - last];
    const HullEdge edge = hull_edge(p, k);
    const float bound = moved + kFootprintSlack * (abs_of(edge.x) + abs_of(edge.y));
    int corners = 0;
    float before_x = f.x[f.corners - 1], before_y = f.y[f.corners - 1];
    float before = edge.x * before_x + edge.y * before_y + edge.offset - bound;
    for (int c = 0; c < f.corners; ++c) {
      const float x = f.x[c], y = f.y[c];
      const float now = edge.x * x + edge.y * y + edge.offset - bound;
      if ((before > 0.0f) != (now > 0.0f) && corners < ConvexFootprint::kCapacity) {
        const float t = before / (before - now);
        cut.x[corners] = before_x + t * (x - before_x);
        cut.y[corners++] = before_y + t * (y - before_y);
      }
      if (!(now > 0.0f) && corners < ConvexFootprint::kCapacity) {
        cut.x[corners] = x;
        cut.y[corners++] = y;
      }
      before = now;
      before_x = x;
      before_y = y;
    }
    cut.corners = corners;
    last = 1 - last;
  }
  const ConvexFootprint& found = polygons[last];
  footprint.corners = found.corners;
  for (int c = 0; c < found.corners; ++c) {
    footprint.x[c] = found.x[c] + p.centre_x;
    footprint.y[c] = found.y[c] + p.centre_y;
  }
}

/// An interval; empty where low > high.
struct Extent {
  float low, high;
};

SPLATBOOST_HOST_DEVICE Extent height_of(const ConvexFootprint& f) {
  Extent extent{1e30f, -1e30f};
  for (int c = 0; c < f.corners; ++c) {
    extent.low = min_of(extent.low, f.y[c]);
    extent.high = max_of(extent.high, f.y[c]);
  }
  return extent;
}

/// Extent in x of the part of a footprint whose y lies in [top, bottom]. All callers must find the same tiles, so the
/// product is not fused with the sum.
SPLATBOOST_HOST_DEVICE Extent width_within(const ConvexFootprint& f, float top, float bottom) {
  Extent extent{1e30f, -1e30f};
  for (int c = 0; c < f.corners; ++c) {
    const int next = c + 1 < f.corners ? c + 1 : 0;
    const float x0 = f.x[c], y0 = f.y[c], x1 = f.x[next], y1 = f.y[next];
    if (y0 >= top && y0 <= bottom) {
      extent.low = min_of(extent.low, x0);
      extent.high = max_of(extent.high, x0);
    }
    for (int side = 0; side < 2; ++side) {
      const float y = side == 0 ? top : bottom;
      if ((y0 < y) != (y1 < y)) {
        const float x = x0 + product_of((y - y0) / (y1 - y0), x1 - x0);
        extent.low = min_of(extent.low, x);
        extent.high = max_of(extent.high, x);
      }
    }
  }
  return extent;
}

/// Sums over the pixels of the gradients of one convex's opacity and of the inputs of its φ.
struct ConvexSums {
  float opacity;    ///< Σ α·dL/dα
  float steepness;  ///< gradient of z·σ
  /// Gradients of the edges' terms z·δ·pixel_size²·L_k, times 1, q_x and q_y (relative to the centre).
  float edge[kMaxConvexPoints][3];
};

/// Gradients of one convex's geometric parameters.
struct ConvexGeometryGradient {
  float smoothness, sharpness;
  float points[kMaxConvexPoints][3];
  float screen[3];  ///< ConvexGradients::screen_points
};

/// @param pixel_area pixel_size²
SPLATBOOST_HOST_DEVICE void project_convex_backward(const ProjectionCamera& camera, const ProjectedConvex& p, int count,
                                                    float smoothness, float sharpness, float pixel_area,
                                                    const ConvexSums& sums, ConvexGeometryGradient& g) {
  g.screen[0] = g.screen[1] = g.screen[2] = 0.0f;
  float g_x[kMaxConvexPoints] = {}, g_y[kMaxConvexPoints] = {};
  const float scale = p.depth * smoothness * pixel_area;
  float g_scale = 0.0f;
  for (int k = 0; k < p.edges; ++k) {
    const HullEdge edge = hull_edge(p, k);
    const float e = sums.edge[k][0], e_x = sums.edge[k][1], e_y = sums.edge[k][2];
    g_scale += edge.x * e_x + edge.y * e_y + edge.offset * e;
    // L = n·(q − a), n = (b_y − a_y, a_x − b_x)
    const int a = p.hull[k], b = p.hull[k + 1 < p.edges ? k + 1 : 0];
    const float g_nx = scale * (e_x - e * p.x[a]), g_ny = scale * (e_y - e * p.y[a]);
    g_x[a] += g_ny - scale * e * edge.x;
    g_y[a] -= g_nx + scale * e * edge.y;
    g_x[b] -= g_ny;
    g_y[b] += g_nx;
  }
  g.sharpness = p.depth * sums.steepness;
  g.smoothness = p.depth * pixel_area * g_scale;
  const float g_depth = (sharpness * sums.steepness + smoothness * pixel_area * g_scale) / static_cast<float>(count);
  for (int i = 0; i < count; ++i) {
    g.screen[0] += g_x[i];
    g.screen[1] += g_y[i];
    g.screen[2] += abs_of(g_x[i]) + abs_of(g_y[i]);
    const float inverse = 1.0f / p.view[i][2];
    const float v_x = camera.fx * g_x[i] * inverse, v_y = camera.fy * g_y[i] * inverse;
    const float v_z = g_depth - (v_x * p.view[i][0] + v_y * p.view[i][1]) * inverse;
    for (int c = 0; c < 3; ++c) {
      g.points[i][c] = camera.axis_x[c] * v_x + camera.axis_y[c] * v_y + camera.axis_z[c] * v_z;
    }
  }
}

}  // namespace splatboost
