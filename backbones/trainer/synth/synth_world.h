// SPDX-License-Identifier: Apache-2.0
/// @file Parts of ray-traced scenes: colour, noise, shapes and a few materials. The world is in metres, z up.
/// Textures are functions of the surface point, blurred to the size of a pixel, so that views agree with each other.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "splatboost/random.h"

namespace splatboost::synthetic {

using Vec3 = glm::dvec3;
using Mat3 = glm::dmat3;

inline constexpr double kPi = std::numbers::pi;

// ---------------------------------------------------------------------------------------------------- colour, noise

/// sRGB 0..255 to linear 0..1. From a table, since textures convert their colours for every sample.
inline Vec3 srgb(int r, int g, int b) {
  static const std::array<double, 256> kLinear = [] {
    std::array<double, 256> table{};
    for (std::size_t i = 0; i < table.size(); ++i) {
      const double value = static_cast<double>(i) / 255.0;
      table[i] = value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
    }
    return table;
  }();
  return {kLinear[static_cast<std::size_t>(r)], kLinear[static_cast<std::size_t>(g)],
          kLinear[static_cast<std::size_t>(b)]};
}

inline std::uint8_t encode_srgb(double linear) {
  linear = std::clamp(linear, 0.0, 1.0);
  const double value = linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1.0 / 2.4) - 0.055;
  return static_cast<std::uint8_t>(std::lround(255.0 * value));
}

inline double mix(double a, double b, double t) { return a + (b - a) * t; }
inline Vec3 mix(const Vec3& a, const Vec3& b, double t) { return a + (b - a) * t; }
inline double fract(double x) { return x - std::floor(x); }

/// 0 below the edge, 1 above, with a ramp as wide as a pixel.
inline double edge(double x, double width) { return std::clamp(x / std::max(width, 1e-9) + 0.5, 0.0, 1.0); }
/// 1 inside [low, high], 0 outside, with the same ramps.
inline double band(double x, double low, double high, double width) {
  return edge(x - low, width) * edge(high - x, width);
}
/// Contrast, from 1 to 0, of a pattern of this period that is left at this pixel width.
inline double visible(double period, double width) { return std::clamp(1.6 - 2.4 * width / period, 0.0, 1.0); }

inline double hash01(std::int64_t x, std::int64_t y, std::int64_t z) {
  const std::uint64_t key = static_cast<std::uint64_t>(x) * 0x8da6b343ull ^
                            static_cast<std::uint64_t>(y) * 0xd8163841ull ^
                            static_cast<std::uint64_t>(z) * 0xcb1ab31full;
  return static_cast<double>(mix_bits(key) >> 40) * 0x1.0p-24;
}
inline double hash01(double x, double y, double z) {
  return hash01(static_cast<std::int64_t>(std::floor(x)), static_cast<std::int64_t>(std::floor(y)),
                static_cast<std::int64_t>(std::floor(z)));
}

/// Smooth noise in [-1, 1] with features of size 1.
inline double noise(const Vec3& p) {
  const auto ix = static_cast<std::int64_t>(std::floor(p.x));
  const auto iy = static_cast<std::int64_t>(std::floor(p.y));
  const auto iz = static_cast<std::int64_t>(std::floor(p.z));
  const auto fade = [](double t) { return t * t * t * (t * (t * 6 - 15) + 10); };
  const double u = fade(p.x - static_cast<double>(ix));
  const double v = fade(p.y - static_cast<double>(iy));
  const double w = fade(p.z - static_cast<double>(iz));
  double planes[2];
  for (int k = 0; k < 2; ++k) {
    const double low = mix(hash01(ix, iy, iz + k), hash01(ix + 1, iy, iz + k), u);
    const double high = mix(hash01(ix, iy + 1, iz + k), hash01(ix + 1, iy + 1, iz + k), u);
    planes[k] = mix(low, high, v);
  }
  return 2 * mix(planes[0], planes[1], w) - 1;
}

/// Octaves of noise, from features of `size` down; those too fine for a pixel are left out.
inline double fractal(const Vec3& p, double size, int octaves, double width) {
  double sum = 0, amplitude = 0.55;
  for (int i = 0; i < octaves; ++i) {
    const double shown = visible(size, width);
    if (shown <= 0) break;
    sum += shown * amplitude * noise(p / size + Vec3(17.3 * i, 5.1 * i, 9.7 * i));
    size *= 0.47;
    amplitude *= 0.62;
  }
  return sum;
}

struct Ray {
  Vec3 origin;
  Vec3 direction;  // unit
};

struct LocalHit {
  double distance = 1e30;
  Vec3 normal{0.0};
};

inline void keep_nearest(LocalHit& hit, double distance, const Vec3& normal) {
  constexpr double kNearest = 1e-6;
  if (distance > kNearest && distance < hit.distance) hit = {distance, normal};
}

inline LocalHit hit_sphere(const Ray& ray, double radius) {
  LocalHit hit;
  const double b = glm::dot(ray.origin, ray.direction);
  const double root = b * b - glm::dot(ray.origin, ray.origin) + radius * radius;
  if (root < 0) return hit;
  const double distance = -b - std::sqrt(root);
  keep_nearest(hit, distance, (ray.origin + distance * ray.direction) / radius);
  return hit;
}

inline LocalHit hit_box(const Ray& ray, const Vec3& half) {
  LocalHit hit;
  double enter = -1e30, leave = 1e30;
  int axis = 0;
  for (int i = 0; i < 3; ++i) {
    const double inverse = 1.0 / ray.direction[i];
    double near_face = (-half[i] - ray.origin[i]) * inverse;
    double far_face = (half[i] - ray.origin[i]) * inverse;
    if (near_face > far_face) std::swap(near_face, far_face);
    if (near_face > enter) {
      enter = near_face;
      axis = i;
    }
    leave = std::min(leave, far_face);
  }
  if (enter >= leave) return hit;
  Vec3 normal(0.0);
  normal[axis] = ray.direction[axis] > 0 ? -1.0 : 1.0;
  keep_nearest(hit, enter, normal);
  return hit;
}

inline void hit_disc(const Ray& ray, double z, double radius, double normal_z, LocalHit& hit) {
  const double distance = (z - ray.origin.z) / ray.direction.z;
  const Vec3 p = ray.origin + distance * ray.direction;
  if (p.x * p.x + p.y * p.y <= radius * radius) keep_nearest(hit, distance, {0, 0, normal_z});
}

/// A cylinder (taper 0) or a cone (taper 1).
inline LocalHit hit_round(const Ray& ray, double radius, double height, double taper) {
  // x² + y² = (radius − slope·z)²
  LocalHit hit;
  const double slope = taper * radius / height;
  const Vec3 &o = ray.origin, &d = ray.direction;
  const double reach = radius - slope * o.z;
  const double a = d.x * d.x + d.y * d.y - slope * slope * d.z * d.z;
  const double b = o.x * d.x + o.y * d.y + slope * d.z * reach;
  const double c = o.x * o.x + o.y * o.y - reach * reach;
  const double root = b * b - a * c;
  if (root >= 0 && std::abs(a) > 1e-14) {
    for (const double sign : {-1.0, 1.0}) {
      const double distance = (-b + sign * std::sqrt(root)) / a;
      const Vec3 p = o + distance * d;
      if (p.z >= 0 && p.z <= height) {
        keep_nearest(hit, distance, glm::normalize(Vec3(p.x, p.y, slope * (radius - slope * p.z))));
      }
    }
  }
  hit_disc(ray, 0, radius, -1, hit);
  if (taper < 1) hit_disc(ray, height, radius * (1 - taper), 1, hit);
  return hit;
}

inline LocalHit hit_torus(const Ray& ray, double large, double small) {
  // Sphere tracing between the ray's entry into and exit from the bounding sphere.
  LocalHit hit;
  const double bound = large + small;
  const double b = glm::dot(ray.origin, ray.direction);
  const double root = b * b - glm::dot(ray.origin, ray.origin) + bound * bound;
  if (root < 0) return hit;
  const double leave = -b + std::sqrt(root);
  double distance = std::max(-b - std::sqrt(root), 0.0);
  for (int step = 0; step < 96 && distance < leave; ++step) {
    const Vec3 p = ray.origin + distance * ray.direction;
    const double ring = std::sqrt(p.x * p.x + p.y * p.y);
    const double gap = std::sqrt((ring - large) * (ring - large) + p.z * p.z) - small;
    if (gap < 1e-6) {
      const Vec3 core = ring > 0 ? Vec3(p.x * large / ring, p.y * large / ring, 0) : Vec3(large, 0, 0);
      keep_nearest(hit, distance, glm::normalize(p - core));
      return hit;
    }
    distance += gap;
  }
  return hit;
}

struct Surface {
  Vec3 albedo{0.5};
  double specular = 0.03;
  double shininess = 30;
};

/// Planks in rows; `along` runs with the grain.
inline Vec3 planks(double along, double across, double plank_width, double plank_length, double seed, double width,
                   const Vec3& dark, const Vec3& light) {
  const double row = std::floor(across / plank_width);
  const double shift = hash01(row, seed, 3.0) * plank_length;
  const double column = std::floor((along + shift) / plank_length);
  const double tone = hash01(row, column, seed + 11);
  const double in_row = fract(across / plank_width) * plank_width;
  const double in_column = fract((along + shift) / plank_length) * plank_length;
  // Grain: noise stretched along the plank, and rings where it bends.
  const Vec3 grain_at(along * 0.12 + 7 * tone, across, 31 * tone + seed);
  const double grain = fractal(grain_at, 0.05, 3, width);
  const double rings = std::sin(95 * across + 9 * fractal(grain_at, 0.25, 2, width)) * visible(0.066, width);
  Vec3 color = mix(dark, light, std::clamp(0.15 + 0.65 * tone + 0.45 * grain + 0.12 * rings, 0.0, 1.0));
  const double gap = std::min(std::min(in_row, plank_width - in_row), std::min(in_column, plank_length - in_column));
  return color * mix(0.28, 1.0, edge(gap - 0.004, std::max(width, 0.005)));
}

inline Vec3 bricks(double u, double v, double seed, double width) {
  constexpr double kLength = 0.26, kHeight = 0.085, kJoint = 0.008;
  const double row = std::floor(v / kHeight);
  const double shifted = u + (std::fmod(std::abs(row), 2.0) < 0.5 ? 0.0 : 0.5 * kLength);
  const double column = std::floor(shifted / kLength);
  const double tone = hash01(row, column, seed);
  const double in_row = fract(v / kHeight) * kHeight;
  const double in_column = fract(shifted / kLength) * kLength;
  const double rim = std::min(std::min(in_row, kHeight - in_row), std::min(in_column, kLength - in_column));
  const Vec3 p(u, v, seed);
  const double grit = fractal(p, 0.06, 3, width);
  Vec3 brick = mix(srgb(116, 52, 38), srgb(196, 112, 80), std::clamp(tone + 0.5 * grit, 0.0, 1.0));
  if (tone > 0.86) brick = mix(brick, srgb(74, 58, 60), 0.65);  // some are over-fired
  const Vec3 mortar = srgb(188, 180, 166) * (1 + 0.35 * grit);
  return mix(mortar, brick, edge(rim - kJoint, std::max(width, 0.006)));
}

/// A Voronoi cell of scattered points: distance to the rim, and the cell's random number in [0, 1).
struct Cell {
  double rim;
  double tone;
};
inline Cell scattered_cell(double u, double v, double seed) {
  double nearest = 1e9, second = 1e9, tone = 0;
  const double base_u = std::floor(u), base_v = std::floor(v);
  for (int j = -1; j <= 1; ++j) {
    for (int i = -1; i <= 1; ++i) {
      const double cell_u = base_u + i, cell_v = base_v + j;
      const double du = cell_u + 0.15 + 0.7 * hash01(cell_u, cell_v, seed) - u;
      const double dv = cell_v + 0.15 + 0.7 * hash01(cell_u, cell_v, seed + 1) - v;
      const double distance = std::sqrt(du * du + dv * dv);
      if (distance < nearest) {
        second = nearest;
        nearest = distance;
        tone = hash01(cell_u, cell_v, seed + 2);
      } else {
        second = std::min(second, distance);
      }
    }
  }
  return {second - nearest, tone};
}

inline Vec3 palette(double tone) {
  static const std::array<Vec3, 7> kColors{srgb(214, 84, 58), srgb(238, 186, 76),  srgb(58, 132, 140),
                                           srgb(36, 66, 110), srgb(240, 230, 204), srgb(128, 156, 82),
                                           srgb(150, 60, 98)};
  return kColors[std::min<std::size_t>(static_cast<std::size_t>(tone * 7), 6)];
}

struct Pose {
  Vec3 centre{0.0};
  Mat3 world_from_camera{1.0};  // columns: right, down, forward
};

/// A level camera at `centre` that looks at `target`.
inline Pose looking(const Vec3& centre, const Vec3& target) {
  const Vec3 forward = glm::normalize(target - centre);
  const Vec3 right = glm::normalize(glm::cross(forward, Vec3(0, 0, 1)));
  return {centre, Mat3(right, glm::cross(forward, right), forward)};
}

/// What a ray hits.
struct Seen {
  double distance = 0;
  Vec3 normal{0.0};     ///< world, towards the ray's origin; 0 for the sky
  bool object = false;  ///< white in masks
  bool sky = false;     ///< no depth; its colour is that of a distant dome, or of a plain backdrop if distance is 0
  Vec3 color{0.0};      ///< linear, after exposure; only from look()
  int solid = -1;       ///< index of the room's solid; -1: none

  bool nothing() const { return sky && distance == 0; }
};

/// A scene and the poses of its cameras. probe() finds the geometry that a ray hits, look() also its colour.
class World {
 public:
  virtual ~World() = default;
  virtual Seen probe(const Ray& ray) const = 0;
  /// @param pixel_angle size of a sample in radians
  virtual Seen look(const Ray& ray, double pixel_angle) const = 0;
  virtual Pose camera(int index, int count, const RandomStream& random) const = 0;
};

std::unique_ptr<World> make_room();
std::unique_ptr<World> make_street();
/// The podium of the room and what stands on it; the rest is sky of one colour. @param backdrop linear
std::unique_ptr<World> make_object(const Vec3& backdrop);
/// The room with moving objects. @param time in [0,1]
std::unique_ptr<World> make_moving_room(double time);

}  // namespace splatboost::synthetic
