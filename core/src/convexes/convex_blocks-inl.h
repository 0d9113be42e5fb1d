// SPDX-License-Identifier: Apache-2.0
/// @file Projection of a block of convexes, one per lane, to the screen: the formulas of convex_math.h, without
/// branches. The numbers of lanes whose convex is not valid are unspecified.
///
/// Compiled once per instruction set (Highway's per-target include), hence no ordinary include guard.

#if defined(SPLATBOOST_CONVEX_BLOCKS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_CONVEX_BLOCKS_INL_H_
#undef SPLATBOOST_CONVEX_BLOCKS_INL_H_
#else
#define SPLATBOOST_CONVEX_BLOCKS_INL_H_
#endif

#include <hwy/highway.h>

#include "convexes/convex_math.h"
#include "projection/primitive_blocks-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

HWY_INLINE bool any_of(Bool condition) { return !hn::AllFalse(Lanes(), condition.m); }
HWY_INLINE Bool not_of(Bool condition) { return {hn::Not(condition.m)}; }
HWY_INLINE Bool are_equal(Float a, Float b) { return {hn::Eq(a.v, b.v)}; }
HWY_INLINE Float multiply_add(Float a, Float b, Float c) { return Float(hn::MulAdd(a.v, b.v, c.v)); }
HWY_INLINE Float multiply_sub(Float a, Float b, Float c) { return Float(hn::MulSub(a.v, b.v, c.v)); }
/// a·b − c·d.
HWY_INLINE Float cross_of(Float a, Float b, Float c, Float d) { return multiply_sub(a, b, c * d); }

/// A block of convexes in the camera frame and on the screen.
struct ConvexBlock {
  Bool valid;
  Vec3<Float> mean;  ///< of the points, in the world
  Float depth;       ///< of the centre
  Float centre_x, centre_y;
  Float x[kMaxConvexPoints], y[kMaxConvexPoints];  ///< px, relative to the centre
  Vec3<Float> view[kMaxConvexPoints];
};

/// Projects the points of a block. Every number is set, even in lanes that are not valid.
/// @param columns [3·K, lanes] points in the world
HWY_INLINE void place_points(const ProjectionCamera& camera, const float* columns, int points, float near_plane,
                             ConvexBlock& p) {
  const Float share(1.0f / static_cast<float>(points));
  const auto point = [&](int k) HWY_ATTR {
    const float* const at = columns + 3 * static_cast<std::size_t>(k) * lanes();
    return Vec3<Float>{load(at), load(at + lanes()), load(at + 2 * lanes())};
  };
  Vec3<Float> sum = point(0);
  for (int k = 1; k < points; ++k) sum = sum + point(k);
  p.mean = share * sum;
  const Vec3<Float> axis_x = widen<Float>(camera.axis_x), axis_y = widen<Float>(camera.axis_y),
                    axis_z = widen<Float>(camera.axis_z);
  const Vec3<Float> centre =
      Vec3<Float>{dot(axis_x, p.mean), dot(axis_y, p.mean), dot(axis_z, p.mean)} + widen<Float>(camera.translation);
  p.depth = centre.z;
  const Float fx(camera.fx), fy(camera.fy), one(1.0f);
  const Float inverse_depth = one / centre.z;
  const Float slope_x = centre.x * inverse_depth, slope_y = centre.y * inverse_depth;
  p.centre_x = multiply_add(fx, slope_x, Float(camera.cx));
  p.centre_y = multiply_add(fy, slope_y, Float(camera.cy));
  p.valid = (p.depth > Float(near_plane)) & (p.depth < Float(1e30f)) & (abs_of(p.centre_x) < Float(1e9f)) &
            (abs_of(p.centre_y) < Float(1e9f));
  for (int k = 0; k < points; ++k) {
    // Computed from differences to the centre, so that small shapes keep their precision.
    const Vec3<Float> d = point(k) - p.mean;
    const Vec3<Float> away{dot(axis_x, d), dot(axis_y, d), dot(axis_z, d)};
    p.view[k] = centre + away;
    const Float inverse = one / p.view[k].z;
    p.x[k] = fx * (away.x - slope_x * away.z) * inverse;
    p.y[k] = fy * (away.y - slope_y * away.z) * inverse;
    // Numbers that are not finite fail a comparison.
    p.valid = p.valid & (p.view[k].z > Float(0.0f)) &
              (multiply_add(p.x[k], p.x[k], p.y[k] * p.y[k]) < Float(kMaxConvexReach * kMaxConvexReach));
  }
}

/// Convex hulls of a block: vertices in order, with the interior to the left of each edge if y points up. After the
/// last vertex, the first is repeated.
struct HullBlock {
  Float edges;
  Float index[kMaxConvexPoints];  ///< of the vertices among the points
  Float x[kMaxConvexPoints], y[kMaxConvexPoints];
};

/// Finds the hull of one lane with convex_math.h.
inline void find_hull_of_lane(const ConvexBlock& p, int points, std::size_t lane, HullBlock& hulls) {
  alignas(64) float column[kMaxLanes];
  ProjectedConvex one;
  for (int k = 0; k < points; ++k) {
    store(p.x[k], column);
    one.x[k] = column[lane];
    store(p.y[k], column);
    one.y[k] = column[lane];
  }
  find_hull(one, points);
  const auto put = [&](Float& to, float value) HWY_ATTR {
    store(to, column);
    column[lane] = value;
    to = load(column);
  };
  const int edges = one.edges <= points ? one.edges : 0;
  put(hulls.edges, static_cast<float>(edges));
  for (int k = 0; k < points; ++k) {
    const int vertex = one.hull[k < edges ? k : 0];
    put(hulls.index[k], static_cast<float>(vertex));
    put(hulls.x[k], one.x[vertex]);
    put(hulls.y[k], one.y[vertex]);
  }
}

/// Convex hulls by Jarvis's march: each edge leads from a vertex to the point for which all others lie to its left, the
/// farthest of collinear ones. Every lane takes the same steps; where rounding keeps a march from returning to its
/// first vertex, convex_math.h finds the hull.
HWY_INLINE void find_hulls(const ConvexBlock& p, int points, HullBlock& hulls) {
  const Float zero(0.0f), one(1.0f);
  Float first_x = p.x[0], first_y = p.y[0], first = zero;
  for (int k = 1; k < points; ++k) {
    const Bool before = (p.x[k] < first_x) | (are_equal(p.x[k], first_x) & (p.y[k] < first_y));
    first_x = select(before, p.x[k], first_x);
    first_y = select(before, p.y[k], first_y);
    first = select(before, Float(static_cast<float>(k)), first);
  }
  Float x = first_x, y = first_y, index = first;
  Bool open = p.valid;
  hulls.edges = zero;
  for (int step = 0; step < points; ++step) {
    hulls.x[step] = x;
    hulls.y[step] = y;
    hulls.index[step] = index;
    hulls.edges += select(open, one, zero);
    Float next_x = x, next_y = y, next = index, best_x = zero, best_y = zero, best_length = zero;
    for (int k = 0; k < points; ++k) {
      const Float to_x = p.x[k] - x, to_y = p.y[k] - y;
      const Float turn = cross_of(best_x, to_y, best_y, to_x);
      const Float length = multiply_add(to_x, to_x, to_y * to_y);
      const Bool turns = turn * turn > Float(kStraight * kStraight) * (length * best_length);
      const Bool better = (turns & (turn < zero)) | (not_of(turns) & (length > best_length));
      best_x = select(better, to_x, best_x);
      best_y = select(better, to_y, best_y);
      best_length = select(better, length, best_length);
      next_x = select(better, p.x[k], next_x);
      next_y = select(better, p.y[k], next_y);
      next = select(better, Float(static_cast<float>(k)), next);
    }
    open = open & not_of(are_equal(next_x, first_x) & are_equal(next_y, first_y));
    x = select(open, next_x, first_x);
    y = select(open, next_y, first_y);
    index = select(open, next, first);
  }
  if (!any_of(open)) return;
  alignas(64) float still_open[kMaxLanes];
  store(select(open, one, zero), still_open);
  for (std::size_t lane = 0; lane < lanes(); ++lane) {
    if (still_open[lane] > 0.0f) find_hull_of_lane(p, points, lane, hulls);
  }
}

/// Edges of a block's hulls, as HullEdge; zero from hulls.edges on.
struct EdgeBlock {
  Float x[kMaxConvexPoints], y[kMaxConvexPoints], offset[kMaxConvexPoints];
};

HWY_INLINE void find_edges(const HullBlock& hulls, int points, EdgeBlock& edges) {
  for (int k = 0; k < points; ++k) {
    const int next = k + 1 < points ? k + 1 : 0;
    edges.x[k] = hulls.y[next] - hulls.y[k];
    edges.y[k] = hulls.x[k] - hulls.x[next];
    edges.offset[k] = -multiply_add(edges.x[k], hulls.x[k], edges.y[k] * hulls.y[k]);
  }
}

/// Greatest φ at which α reaches 1/255 (convex_math.h).
HWY_INLINE Float farthest_of(Float opacity, Float steepness) {
  return Float(kLn2) * log2_of(opacity * Float(1.0f / kMinAlpha) - Float(1.0f)) / steepness;
}

/// released_radius() of convex_math.h. @param margin 2.1/(z²δσ), px²
HWY_INLINE Float released_radii(const HullBlock& hulls, const EdgeBlock& edges, int points, Float margin) {
  const Float zero(0.0f), one(1.0f);
  Float farthest = zero, sum = zero, corners = zero;
  // The predecessor of the first edge is the last one.
  Float before_x = edges.x[0], before_y = edges.y[0], before_offset = edges.offset[0];
  for (int k = 1; k < points; ++k) {
    const Bool is_edge = Float(static_cast<float>(k)) < hulls.edges;
    before_x = select(is_edge, edges.x[k], before_x);
    before_y = select(is_edge, edges.y[k], before_y);
    before_offset = select(is_edge, edges.offset[k], before_offset);
  }
  // Tests whether the angle between two edges is between 0.1 and 3, by its tangent |cross| / dot.
  const float least = 0.10033467208545055f, most = 0.1425465430742778f;  // tan 0.1, −tan 3
  for (int k = 0; k < points; ++k) {
    farthest = max_of(farthest, multiply_add(hulls.x[k], hulls.x[k], hulls.y[k] * hulls.y[k]));
    const Float x = edges.x[k], y = edges.y[k];
    const Float cross = cross_of(before_x, y, before_y, x), dot = multiply_add(before_x, x, before_y * y);
    const Bool counts = (abs_of(cross) > Float(least) * dot) & (abs_of(cross) > Float(-most) * dot) &
                        (Float(static_cast<float>(k)) < hulls.edges);
    const Float a = margin - before_offset, b = margin - edges.offset[k];
    const Float inverse = one / cross;
    const Float corner_x = cross_of(a, y, b, before_y) * inverse, corner_y = cross_of(b, before_x, a, x) * inverse;
    sum += select(counts, sqrt_of(multiply_add(corner_x, corner_x, corner_y * corner_y)), zero);
    corners += select(counts, one, zero);
    before_x = x;
    before_y = y;
    before_offset = edges.offset[k];
  }
  const Float radius = ceil_of(max_of(Float(1.1f) * sqrt_of(farthest), sum / corners));
  return select((corners > zero) & (radius < Float(1e9f)), radius, zero);
}

/// The part of the image that each convex of a block may reach: {q in the image: edge_k·q + offset_k <= bound_k for all
/// k}, px relative to the centre. The polygon's extent in y and its extent in x within a band of rows are needed.
/// Each bound is a linear program in two unknowns: the tightest of the bounds by single edges at the borders and by
/// pairs of edges.
class FootprintBlock {
 public:
  /// @param farthest,scale as in find_footprint()
  HWY_INLINE FootprintBlock(const ConvexBlock& p, const EdgeBlock& edges, int points, Float scale, Float farthest,
                            int width, int height)
      : points_(points) {
    const Float left = Float(0.5f - kFootprintSlack) - p.centre_x,
                right = Float(static_cast<float>(width) - 0.5f + kFootprintSlack) - p.centre_x;
    low_x = left;
    high_x = right;
    low_y = Float(0.5f - kFootprintSlack) - p.centre_y;
    high_y = Float(static_cast<float>(height) - 0.5f + kFootprintSlack) - p.centre_y;
    const Float top = low_y, bottom = high_y;
    const Float moved = (farthest + Float(1e-4f) * abs_of(farthest)) / scale;
    for (int k = 0; k < points; ++k) {
      const Float a = edges.x[k], b = edges.y[k], size_a = abs_of(a), size_b = abs_of(b);
      const Float c = moved + Float(kFootprintSlack) * (size_a + size_b) - edges.offset[k];
      bound_[k] = c;
      // a·x + b·y <= c as a bound of y, and of x: at the side of the image where the bound is loosest.
      const Float in_y = Float(1.0f) / b, in_x = Float(1.0f) / a;
      const Float y = (c - min_of(a * left, a * right)) * in_y;
      const Bool steep_y = size_b > Float(kFlat) * size_a, steep_x = size_a > Float(kFlat) * size_b;
      const Float zero(0.0f), far(kFar);
      high_y = min_of(high_y, select(steep_y & (b > zero), y, far));
      low_y = max_of(low_y, select(steep_y & (b < zero), y, -far));
      const Bool at_right = steep_x & (a > zero), at_left = steep_x & (a < zero);
      const Float at_zero = c * in_x;
      slope_[k] = select(steep_x, b * in_x, zero);
      right_[k] = select(at_right, at_zero, far);
      left_[k] = select(at_left, at_zero, -far);
      high_x = min_of(high_x, right_[k] - min_of(slope_[k] * top, slope_[k] * bottom));
      low_x = max_of(low_x, left_[k] - max_of(slope_[k] * top, slope_[k] * bottom));
    }
    some = (low_x < high_x) & (low_y < high_y) & p.valid;
    if (!any_of(some)) return;
    for (int k = 1; k < points; ++k) {
      for (int l = 0; l < k; ++l) add_pair(edges, k, l);
    }
    some = some & (low_x < high_x) & (low_y < high_y);
  }

  /// Extent in x within the band of rows [top, bottom].
  HWY_INLINE void width_within(Float top, Float bottom, Float& low, Float& high) const {
    top = max_of(top, low_y);
    bottom = min_of(bottom, high_y);
    low = low_x;
    high = high_x;
    for (int k = 0; k < points_; ++k) {
      const Float a = slope_[k] * top, b = slope_[k] * bottom;
      high = min_of(high, right_[k] - min_of(a, b));
      low = max_of(low, left_[k] - max_of(a, b));
    }
  }

  Bool some;  ///< where the part is not empty
  Float low_x, high_x, low_y, high_y;

 private:
  static constexpr float kFlat = 1e-6f;  ///< an edge bounds a coordinate unless it is almost parallel to its axis
  static constexpr float kFar = 1e30f;

  /// Two edges bound a coordinate by their intersection if a positive combination of their normals lies along its axis.
  HWY_INLINE void add_pair(const EdgeBlock& edges, int k, int l) {
    const Float a_k = edges.x[k], b_k = edges.y[k], a_l = edges.x[l], b_l = edges.y[l];
    const Float zero(0.0f), far(kFar), slack(2e-4f);
    const Float kl = a_k * b_l, lk = a_l * b_k;
    const Float cross = kl - lk;
    // Skips almost parallel edges, whose intersection is far away and inaccurate.
    const Bool apart = abs_of(cross) > Float(1e-3f) * (abs_of(kl) + abs_of(lk));
    const Float inverse = Float(1.0f) / cross;
    const Float x = cross_of(bound_[k], b_l, bound_[l], b_k) * inverse;
    const Float y = cross_of(bound_[l], a_k, bound_[k], a_l) * inverse;
    const Bool bounds_x = apart & (b_k * b_l < zero), bounds_y = apart & (a_k * a_l < zero);
    const Bool upper_x = {hn::Xor((cross > zero).m, (b_l < zero).m)};
    const Bool upper_y = {hn::Xor((cross > zero).m, (a_k < zero).m)};
    const Float more_x = slack * abs_of(x), more_y = slack * abs_of(y);
    high_x = min_of(high_x, select(bounds_x & upper_x, x + more_x, far));
    low_x = max_of(low_x, select(bounds_x & not_of(upper_x), x - more_x, -far));
    high_y = min_of(high_y, select(bounds_y & upper_y, y + more_y, far));
    low_y = max_of(low_y, select(bounds_y & not_of(upper_y), y - more_y, -far));
  }

  int points_;
  Float bound_[kMaxConvexPoints];
  Float slope_[kMaxConvexPoints];  ///< x = right − slope·y, or left − slope·y, along an edge
  Float right_[kMaxConvexPoints], left_[kMaxConvexPoints];
};

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
