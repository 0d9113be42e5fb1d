// SPDX-License-Identifier: Apache-2.0
/// @file Planes, rays and two views of one surface, for any type of number: float in loops and kernels, double in
/// tests.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "device/host_device.h"
#include "geometry/surface_workspace.h"
#include "splatboost/camera.h"

namespace splatboost::surface {

template <class Real>
struct Vector {
  Real x, y, z;
};
template <class Real>
SPLATBOOST_HOST_DEVICE Vector<Real> operator+(Vector<Real> a, Vector<Real> b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class Real>
SPLATBOOST_HOST_DEVICE Vector<Real> operator-(Vector<Real> a, Vector<Real> b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class Real>
SPLATBOOST_HOST_DEVICE Vector<Real> operator*(Real s, Vector<Real> a) {
  return {s * a.x, s * a.y, s * a.z};
}
template <class Real>
SPLATBOOST_HOST_DEVICE Real dot(Vector<Real> a, Vector<Real> b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class Real>
SPLATBOOST_HOST_DEVICE Vector<Real> cross(Vector<Real> a, Vector<Real> b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// Rows of a rotation, and a shift: x ↦ R·x + t.
template <class Real>
struct Motion {
  Vector<Real> rows[3];
  Vector<Real> shift;
  SPLATBOOST_HOST_DEVICE Vector<Real> turned(Vector<Real> v) const {
    return {dot(rows[0], v), dot(rows[1], v), dot(rows[2], v)};
  }
  SPLATBOOST_HOST_DEVICE Vector<Real> turned_back(Vector<Real> v) const {
    return (v.x * rows[0] + v.y * rows[1]) + v.z * rows[2];
  }
  SPLATBOOST_HOST_DEVICE Vector<Real> operator()(Vector<Real> v) const { return turned(v) + shift; }
  SPLATBOOST_HOST_DEVICE Vector<Real> inverse(Vector<Real> v) const { return turned_back(v - shift); }
};

/// A camera without its pose.
template <class Real>
struct Pinhole {
  Real fx, fy, cx, cy;
  int width, height;
  /// The ray through (x, y) px, with depth 1.
  SPLATBOOST_HOST_DEVICE Vector<Real> ray(Real x, Real y) const { return {(x - cx) / fx, (y - cy) / fy, Real(1)}; }
};

template <class Real>
Pinhole<Real> pinhole_of(const Camera& camera) {
  return {Real(camera.fx), Real(camera.fy), Real(camera.cx), Real(camera.cy), camera.width, camera.height};
}

template <class Real>
Motion<Real> camera_from_world_of(const Camera& camera) {
  Motion<Real> motion;
  for (int k = 0; k < 3; ++k) {
    motion.rows[k] = {Real(camera.camera_from_world[0][k]), Real(camera.camera_from_world[1][k]),
                      Real(camera.camera_from_world[2][k])};
  }
  motion.shift = {Real(camera.camera_from_world[3][0]), Real(camera.camera_from_world[3][1]),
                  Real(camera.camera_from_world[3][2])};
  return motion;
}

/// second_from_first of two cameras, computed in double.
template <class Real>
Motion<Real> motion_between(const Camera& first, const Camera& second) {
  const auto a = camera_from_world_of<double>(first), b = camera_from_world_of<double>(second);
  Motion<Real> between;
  for (int k = 0; k < 3; ++k) {
    const Vector<double> row = a.turned(b.rows[k]);  // row k of R_b·R_aᵀ
    between.rows[k] = {Real(row.x), Real(row.y), Real(row.z)};
  }
  const Vector<double> shift = b(a.inverse({0, 0, 0}));
  between.shift = {Real(shift.x), Real(shift.y), Real(shift.z)};
  return between;
}

// Planes of Gaussians.

template <class Real>
SPLATBOOST_HOST_DEVICE int shortest_axis(const Real* scales) {
  const int of_two = scales[1] < scales[0] ? 1 : 0;
  return scales[2] < scales[of_two] ? 2 : of_two;
}

// Depth of a blended plane.

template <class Real>
struct Plane {
  Vector<Real> normal;  ///< in the camera frame, towards the camera
  Real distance;
};

/// The blended normal must face the camera by at least this.
template <class Real>
inline constexpr Real kMinFacing = Real(1e-8);

template <class Real>
SPLATBOOST_HOST_DEVICE Real depth_of(const Plane<Real>& blended, Vector<Real> ray) {
  const Real facing = -dot(blended.normal, ray);
  return facing > kMinFacing<Real> ? blended.distance / facing : Real(0);
}
template <class Real>
SPLATBOOST_HOST_DEVICE Plane<Real> depth_backward(const Plane<Real>& blended, Vector<Real> ray, Real g_depth) {
  const Real facing = -dot(blended.normal, ray);
  if (!(facing > kMinFacing<Real>)) return {{0, 0, 0}, 0};
  const Real g_distance = g_depth / facing;
  return {(g_distance * blended.distance / facing) * ray, g_distance};
}

// Normals of depth.

/// The normal from the points of a pixel's neighbours, in the camera frame.
template <class Real>
struct Cross {
  Vector<Real> right_left, top_bottom;  ///< differences
  Vector<Real> normal;                  ///< unit; 0 where there is none
  Real length;                          ///< of the cross product of the differences
};
template <class Real>
SPLATBOOST_HOST_DEVICE Cross<Real> cross_of(Vector<Real> right, Vector<Real> left, Vector<Real> top,
                                            Vector<Real> bottom) {
  Cross<Real> out;
  out.right_left = right - left;
  out.top_bottom = top - bottom;
  const Vector<Real> product = cross(out.right_left, out.top_bottom);
  out.length = std::sqrt(dot(product, product));
  const bool flat = !(out.length > 0) || !(right.z > 0 && left.z > 0 && top.z > 0 && bottom.z > 0);
  out.normal = flat ? Vector<Real>{0, 0, 0} : (1 / out.length) * product;
  if (flat) out.length = 0;
  return out;
}
/// The normal at a pixel; 0 on the border. @param depth [H,W]
template <class Real, class Image>
SPLATBOOST_HOST_DEVICE Cross<Real> normal_of_depth(const Pinhole<Real>& pinhole, const Image& depth, int x, int y) {
  if (x == 0 || y == 0 || x == pinhole.width - 1 || y == pinhole.height - 1) {
    return {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}, 0};
  }
  const auto row = static_cast<std::size_t>(pinhole.width);
  const std::size_t p = static_cast<std::size_t>(y) * row + static_cast<std::size_t>(x);
  const Real at_x = Real(x) + Real(0.5), at_y = Real(y) + Real(0.5);
  return cross_of(Real(depth[p + 1]) * pinhole.ray(at_x + 1, at_y), Real(depth[p - 1]) * pinhole.ray(at_x - 1, at_y),
                  Real(depth[p - row]) * pinhole.ray(at_x, at_y - 1),
                  Real(depth[p + row]) * pinhole.ray(at_x, at_y + 1));
}
/// Gradients of the two differences.
template <class Real>
SPLATBOOST_HOST_DEVICE void cross_backward(const Cross<Real>& at, Vector<Real> g_normal, Vector<Real>& g_right_left,
                                           Vector<Real>& g_top_bottom) {
  g_right_left = g_top_bottom = {0, 0, 0};
  if (!(at.length > 0)) return;
  const Vector<Real> g = (1 / at.length) * (g_normal - dot(g_normal, at.normal) * at.normal);
  g_right_left = cross(at.top_bottom, g);
  g_top_bottom = cross(g, at.right_left);
}

/// Gradient of a pixel's point, which takes part in the differences of its four neighbours.
/// @param differences [6,H,W] gradients of (right − left, top − bottom), 0 on the border
template <class Image>
SPLATBOOST_HOST_DEVICE Vector<float> gather_differences(const Pinhole<float>& pinhole, const Image& differences, int x,
                                                        int y) {
  const auto row = static_cast<std::size_t>(pinhole.width);
  const std::size_t pixels = row * static_cast<std::size_t>(pinhole.height);
  const std::size_t p = static_cast<std::size_t>(y) * row + static_cast<std::size_t>(x);
  float g[3] = {0, 0, 0};
  for (std::size_t c = 0; c < 3; ++c) {
    if (x > 0) g[c] += differences[c * pixels + p - 1];
    if (x + 1 < pinhole.width) g[c] -= differences[c * pixels + p + 1];
    if (y + 1 < pinhole.height) g[c] += differences[(c + 3) * pixels + p + row];
    if (y > 0) g[c] -= differences[(c + 3) * pixels + p - row];
  }
  return {g[0], g[1], g[2]};
}

// Two views.

/// Bilinear, with the border repeated. Pixel centres are at .5, as everywhere.
template <class Real>
struct Bilinear {
  int x0, x1, y0, y1;
  Real fraction_x, fraction_y;
  bool inside_x, inside_y;  ///< not clamped: the derivative is not 0

  SPLATBOOST_HOST_DEVICE Bilinear(Real x, Real y, int width, int height) {
    const Real last_x = Real(width - 1), last_y = Real(height - 1);
    const Real shifted_x = x - Real(0.5), shifted_y = y - Real(0.5);
    inside_x = shifted_x > 0 && shifted_x < last_x;
    inside_y = shifted_y > 0 && shifted_y < last_y;
    const Real in_x = shifted_x < 0 ? Real(0) : shifted_x > last_x ? last_x : shifted_x;
    const Real in_y = shifted_y < 0 ? Real(0) : shifted_y > last_y ? last_y : shifted_y;
    x0 = static_cast<int>(in_x);
    y0 = static_cast<int>(in_y);
    x1 = x0 + 1 < width ? x0 + 1 : x0;
    y1 = y0 + 1 < height ? y0 + 1 : y0;
    fraction_x = in_x - Real(x0);
    fraction_y = in_y - Real(y0);
  }
  SPLATBOOST_HOST_DEVICE std::size_t index(int x, int y, int width) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
  }
  /// Weights of the four texels (x0,y0), (x1,y0), (x0,y1), (x1,y1).
  SPLATBOOST_HOST_DEVICE void weights(Real (&w)[4]) const {
    w[0] = (1 - fraction_x) * (1 - fraction_y);
    w[1] = fraction_x * (1 - fraction_y);
    w[2] = (1 - fraction_x) * fraction_y;
    w[3] = fraction_x * fraction_y;
  }
};

/// A sample and its derivatives.
template <class Real>
struct Sample {
  Real value, slope_x, slope_y;
};
/// @param image [H,W], of any type with operator[]
template <class Real, class Image>
SPLATBOOST_HOST_DEVICE Sample<Real> sample(const Image& image, const Bilinear<Real>& at, int width) {
  const Real a = Real(image[at.index(at.x0, at.y0, width)]), b = Real(image[at.index(at.x1, at.y0, width)]);
  const Real c = Real(image[at.index(at.x0, at.y1, width)]), d = Real(image[at.index(at.x1, at.y1, width)]);
  const Real top = a + at.fraction_x * (b - a), bottom = c + at.fraction_x * (d - c);
  const Real across = (b - a) + at.fraction_y * ((d - c) - (b - a));
  return {top + at.fraction_y * (bottom - top), at.inside_x ? across : Real(0), at.inside_y ? bottom - top : Real(0)};
}

/// The two views of a comparison.
template <class Real>
struct ViewPair {
  Pinhole<Real> first, second;
  Motion<Real> second_from_first;
};
template <class Real>
ViewPair<Real> pair_of(const Camera& first, const Camera& second) {
  return {pinhole_of<Real>(first), pinhole_of<Real>(second), motion_between<Real>(first, second)};
}

/// Reprojection of a pixel of the first view to the second and back.
template <class Real>
struct Reprojection {
  bool agrees;    ///< the pixel can be reprojected, with an error below the limit
  Real noise;     ///< reprojection error, px
  Real x, y;      ///< position in the second view, px
  Real g_first;   ///< total ∂ noise / ∂ depth of the first view
  Real g_second;  ///< ∂ noise / ∂ depth of the second view at (x, y)
};
/// @param x,y the pixel's centre
/// @param depths of the second view, [H,W]
template <class Real, class Image>
SPLATBOOST_HOST_DEVICE Reprojection<Real> reproject(const ViewPair<Real>& views, Real x, Real y, Real depth,
                                                    const Image& depths, Real max_noise, Real near_depth) {
  Reprojection<Real> out{false, 0, 0, 0, 0, 0};
  const Pinhole<Real>&a = views.first, &b = views.second;
  const Motion<Real>& motion = views.second_from_first;
  if (!(depth > near_depth)) return out;
  const Vector<Real> ray = a.ray(x, y);
  const Vector<Real> there = motion(depth * ray);
  if (!(there.z > near_depth)) return out;
  out.x = b.fx * there.x / there.z + b.cx;
  out.y = b.fy * there.y / there.z + b.cy;
  if (!(out.x >= 0 && out.x < Real(b.width) && out.y >= 0 && out.y < Real(b.height))) return out;
  const Sample<Real> found = sample<Real>(depths, Bilinear<Real>(out.x, out.y, b.width, b.height), b.width);
  if (!(found.value > near_depth)) return out;
  const Vector<Real> ray_there = b.ray(out.x, out.y);
  const Vector<Real> back = motion.inverse(found.value * ray_there);
  if (!(back.z > near_depth)) return out;
  const Real dx = a.fx * back.x / back.z + a.cx - x, dy = a.fy * back.y / back.z + a.cy - y;
  out.noise = std::sqrt(dx * dx + dy * dy);
  if (!(out.noise < max_noise)) return out;
  out.agrees = true;
  if (!(out.noise > 0)) return out;
  // Backward pass: noise → point → its depth and place in the second view → depth in the first.
  const Real g_x = dx / out.noise * a.fx / back.z, g_y = dy / out.noise * a.fy / back.z;
  const Vector<Real> g_back{g_x, g_y, -(g_x * back.x + g_y * back.y) / back.z};
  const Vector<Real> g_there = motion.turned(g_back);
  out.g_second = dot(g_there, ray_there);
  const Real g_out_x = g_there.x * found.value / b.fx + out.g_second * found.slope_x;
  const Real g_out_y = g_there.y * found.value / b.fy + out.g_second * found.slope_y;
  const Real p_x = g_out_x * b.fx / there.z, p_y = g_out_y * b.fy / there.z;
  const Vector<Real> g_point{p_x, p_y, -(p_x * there.x + p_y * there.y) / there.z};
  out.g_first = dot(motion.turned(ray), g_point);
  return out;
}

/// Whether the pixel that contains (x, y) px has no data. @param valid [H,W]; empty: all have data
template <class Mask>
SPLATBOOST_HOST_DEVICE bool is_masked(const Mask& valid, float x, float y, int width) {
  return !valid.empty() &&
         valid[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)] == 0;
}

/// reproject() of pixel (x, y), in the form in which it is stored. Pixels that are masked in either photo do not match.
template <class Image, class Mask>
SPLATBOOST_HOST_DEVICE PixelMatch match_pixel(const ViewPair<float>& views, int x, int y, float depth,
                                              const Image& depths, const Mask& valid_first, const Mask& valid_second,
                                              const SurfaceTerms& terms) {
  const float at_x = static_cast<float>(x) + 0.5f, at_y = static_cast<float>(y) + 0.5f;
  const Reprojection<float> found =
      reproject(views, at_x, at_y, depth, depths, terms.max_pixel_noise, terms.near_depth);
  const bool matches = found.agrees && !is_masked(valid_first, at_x, at_y, views.first.width) &&
                       !is_masked(valid_second, found.x, found.y, views.second.width);
  return {matches ? found.noise : -1.0f, found.x, found.y, found.g_first, found.g_second};
}

/// Weight of a pixel, given how strong an edge the photo has there. @param edge 0 to 1
template <class Real>
SPLATBOOST_HOST_DEVICE Real edge_weight(Real edge) {
  const Real rest = edge < 0 ? Real(1) : edge > 1 ? Real(0) : 1 - edge;
  return rest * rest;
}

/// Whether a pixel and its four neighbours have data. @param x,y not on the border @param valid [H,W]; empty: all have
template <class Mask>
SPLATBOOST_HOST_DEVICE bool has_data_around(const Mask& valid, int x, int y, int width) {
  if (valid.empty()) return true;
  const auto row = static_cast<std::size_t>(width);
  const std::size_t p = static_cast<std::size_t>(y) * row + static_cast<std::size_t>(x);
  return valid[p] != 0 && valid[p - 1] != 0 && valid[p + 1] != 0 && valid[p - row] != 0 && valid[p + row] != 0;
}

/// Largest central difference along x or y, mean over channels; 0 on the border, which has weight 0 anyway.
template <class Image>
SPLATBOOST_HOST_DEVICE float edge_of(const Image& color, int x, int y, int width, int height) {
  if (x == 0 || y == 0 || x == width - 1 || y == height - 1) return 0;
  const auto row = static_cast<std::size_t>(width);
  const std::size_t pixels = row * static_cast<std::size_t>(height);
  const std::size_t at = static_cast<std::size_t>(y) * row + static_cast<std::size_t>(x);
  int along_x = 0, along_y = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    const std::size_t p = c * pixels + at;
    const int dx = static_cast<int>(color[p + 1]) - static_cast<int>(color[p - 1]);
    const int dy = static_cast<int>(color[p + row]) - static_cast<int>(color[p - row]);
    along_x += dx < 0 ? -dx : dx;
    along_y += dy < 0 ? -dy : dy;
  }
  return static_cast<float>(along_x > along_y ? along_x : along_y);
}

/// NaN where the photo is masked, so that no patch counts which contains the pixel.
template <class Image, class Mask>
SPLATBOOST_HOST_DEVICE float grey_of(const Image& color, const Mask& valid, std::size_t pixel, std::size_t pixels) {
  if (!valid.empty() && valid[pixel] == 0) return NAN;
  return (0.299f * static_cast<float>(color[pixel]) + 0.587f * static_cast<float>(color[pixels + pixel]) +
          0.114f * static_cast<float>(color[2 * pixels + pixel])) *
         (1.0f / 255.0f);
}

}  // namespace splatboost::surface
