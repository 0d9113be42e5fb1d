// SPDX-License-Identifier: Apache-2.0
#include "common/synth.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <span>
#include <string>
#include <system_error>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <glm/mat3x3.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "common/colmap.h"
#include "common/input_error.h"
#include "common/synth_world.h"
#include "common/view_image.h"
#include "splatboost/random.h"
#include "splatboost/threads.h"

// A room holds a podium with objects; cameras stand around it and look inwards.

namespace splatboost {
namespace {

using namespace synthetic;

constexpr Vec3 kRoomLow{-3.2, -2.8, 0.0};
constexpr Vec3 kRoomHigh{3.2, 2.8, 2.7};
constexpr double kRugRadius = 1.78;
constexpr double kFieldOfView = 66.0 * kPi / 180.0;  // horizontal

// --------------------------------------------------------------------------------------------------------- geometry

enum class Shape { sphere, box, cylinder, cone, torus };

enum class Material {
  podium,
  globe,
  beach_ball,
  crate,
  stone,
  candy,
  bronze,
  spiral,
  mosaic,
  can,
  marble,
  column,
  dice
};

/// A solid in its own frame: spheres and boxes around the origin, cylinders and cones up from z = 0, a torus around z.
struct Solid {
  Shape shape;
  Material material;
  Vec3 size;  // sphere: radius; box: half sides; cylinder, cone: radius, -, height; torus: large radius, small radius
  Vec3 position;
  Mat3 local_from_world{1.0};
  Vec3 bound_centre{0.0};  // of a sphere around the solid, world
  double bound_radius = 0;
  double seed = 0;  // makes textures of one material differ
};

struct Hit {
  double distance = 1e30;
  Vec3 normal{0.0};  // world, towards the ray's origin
  int solid = -1;    // -1: the room
  int wall = 0;      // of the room: 0/1 x low/high, 2/3 y, 4 floor, 5 ceiling
};

/// Most rays miss most solids: does this one come near, before `farthest`?
inline bool comes_near(const Solid& solid, const Ray& ray, double farthest) {
  const Vec3 to_centre = solid.bound_centre - ray.origin;
  const double along = glm::dot(to_centre, ray.direction);
  const double radius = solid.bound_radius;
  return glm::dot(to_centre, to_centre) - along * along <= radius * radius && along >= -radius &&
         along - radius <= farthest;
}

LocalHit hit_solid(const Solid& solid, const Ray& ray) {
  const Ray local{solid.local_from_world * (ray.origin - solid.position), solid.local_from_world * ray.direction};
  switch (solid.shape) {
    case Shape::sphere:
      return hit_sphere(local, solid.size.x);
    case Shape::box:
      return hit_box(local, solid.size);
    case Shape::cylinder:
      return hit_round(local, solid.size.x, solid.size.z, 0);
    case Shape::cone:
      return hit_round(local, solid.size.x, solid.size.z, 1);
    case Shape::torus:
      return hit_torus(local, solid.size.x, solid.size.y);
  }
  return {};
}

// ---------------------------------------------------------------------------------------------------------- textures

/// A picture of size 1 × 1 around the origin: hills under a sun, or a field of coloured shards.
Vec3 painting(double u, double v, int kind, double width) {
  if (kind % 2 == 0) {
    Vec3 color = mix(srgb(250, 206, 140), srgb(70, 120, 178), std::clamp(v + 0.45, 0.0, 1.0));
    const double sun = std::hypot(u - 0.18, v - 0.16);
    color = mix(srgb(255, 244, 204), color, edge(sun - 0.09, width));
    for (int ridge = 0; ridge < 4; ++ridge) {
      const double height = 0.12 - 0.15 * ridge + 0.16 * fractal({u, 3.0 * ridge + kind, 0.5}, 0.3, 4, width);
      const Vec3 hill =
          mix(srgb(116, 134, 158), srgb(24, 62, 40), ridge / 3.0) * (1 + 0.4 * fractal({u, v, 8.0}, 0.04, 2, width));
      color = mix(color, hill, edge(height - v, width));
    }
    return color;
  }
  const Cell cell = scattered_cell(u * 7, v * 7, 40.0 + kind);
  const Vec3 color = palette(cell.tone) * (1 + 0.25 * fractal({u, v, 1.0 * kind}, 0.06, 2, width));
  return mix(srgb(24, 22, 26), color, edge(cell.rim - 0.07, 7 * width));
}

/// Hangs a framed picture at (u, v); tells whether the point lies on it.
bool framed_painting(double u, double v, double centre_u, double centre_v, double half_u, double half_v, int kind,
                     double width, Surface& surface) {
  constexpr double kFrame = 0.055;
  const double x = std::abs(u - centre_u) - half_u, y = std::abs(v - centre_v) - half_v;
  const double outside = std::max(x, y);
  if (outside > kFrame) return false;
  const Vec3 inside =
      painting(0.5 * (u - centre_u) / half_u, 0.5 * (v - centre_v) / half_v, kind, 0.5 * width / half_v);
  const double carving = std::sin(2 * kPi * (u + v) / 0.045) * visible(0.045, width);
  const Vec3 gold = srgb(196, 148, 66) * (1 + 0.35 * carving) * mix(0.5, 1.15, fract((outside + kFrame) / 0.028));
  surface.albedo = mix(inside, gold, edge(outside, width));
  surface.specular = 0.05;
  return true;
}

Vec3 wallpaper(double u, double v, double width) {
  // Damask: rows of petals, every other row shifted, on stripes.
  constexpr double kPeriod = 0.34;
  const double row = std::floor(v / kPeriod);
  const double shift = std::fmod(std::abs(row), 2.0) < 0.5 ? 0.0 : 0.5;
  const double x = (fract(u / kPeriod + shift) - 0.5) * 2, y = (fract(v / kPeriod) - 0.5) * 2;
  const double angle = std::atan2(y, x), radius = std::hypot(x, y);
  const double pixel = 2 * width / kPeriod;
  const double flower = edge(0.52 + 0.24 * std::cos(6 * angle) - radius, pixel);
  const double heart = edge(0.2 + 0.05 * std::cos(12 * angle) - radius, pixel);
  const double ring = band(radius, 0.86, 0.93, pixel);
  const double stripe = band(fract(u / kPeriod + 0.5), 0.0, 0.06, width / kPeriod);
  Vec3 color = srgb(54, 98, 104) * (1 + 0.16 * fractal({u, v, 2.0}, 0.05, 3, width));
  color = mix(color, srgb(116, 160, 150), 0.85 * flower);
  color = mix(color, srgb(226, 196, 128), std::max({heart, ring, stripe}));
  return color;
}

Surface wall_surface(int wall, const Vec3& p, double width) {
  Surface surface;
  const bool along_y = wall < 2;
  const double u = along_y ? p.y : p.x, v = p.z;
  constexpr double kWainscot = 0.78;
  const double sign = wall % 2 == 0 ? 1.0 : -1.0;
  if (framed_painting(u, v, sign * 0.95, 1.58, 0.55, 0.4, wall, width, surface)) return surface;
  if (framed_painting(u, v, sign * -0.75, 1.6, 0.36, 0.46, wall + 1, width, surface)) return surface;
  if (!along_y && v < kWainscot) {
    surface.albedo = planks(v, u, 0.16, 3.0, 5.0 + wall, width, srgb(62, 34, 20), srgb(140, 86, 48));
    const double rail = band(v, kWainscot - 0.07, kWainscot - 0.01, width) + band(v, 0.0, 0.1, width);
    surface.albedo *= mix(1.0, 0.6, std::min(rail, 1.0));
    surface.specular = 0.06;
    return surface;
  }
  surface.albedo = along_y ? bricks(u, v, 2.0 + wall, width) : wallpaper(u, v, width);
  const double skirting = edge((along_y ? 0.11 : 0.0) - v, width);
  surface.albedo = mix(surface.albedo, srgb(228, 220, 204), skirting);
  return surface;
}

Surface floor_surface(const Vec3& p, double width) {
  Surface surface;
  const double radius = std::hypot(p.x, p.y), angle = std::atan2(p.y, p.x);
  surface.albedo = planks(p.x, p.y, 0.19, 1.3, 1.0, width, srgb(84, 48, 26), srgb(196, 138, 84));
  surface.specular = 0.08;
  if (radius < kRugRadius + width) {
    const double weave = std::sin(2 * kPi * p.x / 0.024) * std::sin(2 * kPi * p.y / 0.024) * visible(0.024, width);
    const double fuzz = fractal(p, 0.03, 2, width);
    const double zigzag = std::abs(fract(angle * 18 / kPi) - 0.5) * 2;
    const double arc = radius * kPi / 18;  // length of one zigzag, to size its blur
    Vec3 rug = srgb(140, 34, 40);
    rug = mix(rug, srgb(28, 42, 84), edge(radius - 1.28 - 0.09 * zigzag, width + 0.1 * width / arc));
    rug = mix(rug, srgb(232, 214, 170), band(radius, 1.22 + 0.09 * zigzag, 1.27 + 0.09 * zigzag, width));
    const double x = fract(angle * 12 / kPi) - 0.5, y = (radius - 1.53) / (radius * kPi / 12);
    const double diamond = std::abs(x) + std::abs(y);
    const double pixel = width / (radius * kPi / 12);
    rug = mix(rug, srgb(222, 160, 62), edge(0.42 - diamond, pixel));
    rug = mix(rug, srgb(28, 42, 84), edge(0.27 - diamond, pixel));
    rug = mix(rug, srgb(232, 214, 170), edge(0.14 - diamond, pixel));
    rug = mix(rug, srgb(232, 214, 170), edge(radius - (kRugRadius - 0.06), width));
    surface.albedo = mix(surface.albedo, rug * (1 + 0.16 * weave + 0.22 * fuzz), edge(kRugRadius - radius, width));
    surface.specular = mix(0.08, 0.0, edge(kRugRadius - radius, width));
  }
  return surface;
}

Surface ceiling_surface(const Vec3& p, double width) {
  Surface surface;
  constexpr double kPanel = 0.8;
  const double x = std::abs(fract(p.x / kPanel) - 0.5) * 2, y = std::abs(fract(p.y / kPanel) - 0.5) * 2;
  const double rim = std::max(x, y), pixel = 2 * width / kPanel;
  surface.albedo = srgb(226, 222, 212) * (1 + 0.1 * fractal(p, 0.12, 3, width));
  surface.albedo *= mix(1.0, 0.62, band(rim, 0.78, 0.84, pixel));
  surface.albedo = mix(surface.albedo, srgb(150, 110, 74) * (1 + 0.25 * fractal({p.x * 0.3, p.y, 3.0}, 0.08, 2, width)),
                       edge(rim - 0.88, pixel));
  const double rosette = std::hypot(x, y) - 0.35 - 0.08 * std::cos(8 * std::atan2(y, x));
  surface.albedo = mix(surface.albedo, srgb(186, 150, 96), edge(-rosette, pixel));
  surface.specular = 0.0;
  return surface;
}

/// @param p point in the solid's own frame; @param n normal there
Surface solid_surface(const Solid& solid, const Vec3& p, const Vec3& n, double width) {
  Surface surface;
  const double angle = std::atan2(p.y, p.x);
  switch (solid.material) {
    case Material::podium: {
      // Terrazzo on top, carved stone around.
      if (n.z > 0.5) {
        const double radius = std::hypot(p.x, p.y);
        const Cell cell = scattered_cell(p.x / 0.055, p.y / 0.055, 7);
        const double chip = edge(cell.rim - 0.25 - 0.3 * cell.tone, width / 0.055) * visible(0.05, width);
        surface.albedo = srgb(214, 206, 190) * (1 + 0.12 * fractal(p, 0.05, 3, width));
        surface.albedo = mix(surface.albedo, palette(fract(cell.tone * 13)) * 0.8, 0.85 * chip);
        surface.albedo = mix(surface.albedo, srgb(44, 58, 70), band(radius, 1.06, 1.1, width));
      } else {
        const double flute = std::cos(angle * 60);
        surface.albedo = srgb(186, 176, 158) * (0.82 + 0.18 * flute) * (1 + 0.25 * fractal(p, 0.09, 4, width));
        surface.albedo *= mix(1.0, 0.6, band(p.z, 0.03, 0.045, width));
      }
      surface.specular = 0.08;
      break;
    }
    case Material::globe: {
      const Vec3 unit = p / solid.size.x;
      const double land = fractal(unit, 0.75, 5, width / solid.size.x) - 0.02;
      const double pixel = 1.4 * width / solid.size.x;
      const double relief = fractal(unit + Vec3(4.0), 0.16, 3, width / solid.size.x);
      const Vec3 ocean =
          mix(srgb(18, 58, 120), srgb(48, 126, 168), std::clamp(0.5 + 1.6 * land + 0.25 * relief, 0.0, 1.0));
      const Vec3 ground =
          mix(srgb(78, 128, 58), srgb(206, 178, 112), std::clamp(0.45 + 2.2 * land + 0.7 * relief, 0.0, 1.0));
      surface.albedo = mix(ocean, ground, edge(land, pixel));
      surface.albedo = mix(surface.albedo, srgb(240, 244, 248), edge(std::abs(unit.z) - 0.86 + 0.1 * relief, pixel));
      const double latitude = std::asin(std::clamp(unit.z, -1.0, 1.0));
      const double parallel = std::abs(fract(latitude * 12 / kPi + 0.5) - 0.5) * kPi / 12;
      const double around = std::max(0.15, std::cos(latitude));
      const double meridian = std::abs(fract(angle * 12 / kPi + 0.5) - 0.5) * kPi / 12 * around;
      surface.albedo =
          mix(srgb(236, 222, 180), surface.albedo, mix(1.0, edge(std::min(parallel, meridian) - 0.009, pixel), 0.7));
      surface.specular = 0.22;
      surface.shininess = 50;
      break;
    }
    case Material::beach_ball: {
      const Vec3 unit = p / solid.size.x;
      const double pixel = width / solid.size.x;
      const double sector = angle * 4 / kPi + 0.5 * unit.z;
      const double tone = hash01(std::floor(fract(sector / 8) * 8), solid.seed, 1.0);
      surface.albedo =
          palette(fract(tone * 5 + solid.seed * 0.37)) * (1 + 0.2 * fractal(unit + Vec3(solid.seed), 0.2, 3, pixel));
      const double seam = std::abs(fract(sector + 0.5) - 0.5) * std::sqrt(std::max(0.0, 1 - unit.z * unit.z));
      surface.albedo = mix(srgb(246, 240, 226), surface.albedo, edge(seam - 0.05, 1.3 * pixel));
      surface.albedo = mix(surface.albedo, srgb(246, 240, 226), edge(std::abs(unit.z) - 0.93, pixel));
      surface.specular = 0.28;
      surface.shininess = 60;
      break;
    }
    case Material::crate: {
      const Vec3 a = glm::abs(n);
      const double u = a.x > 0.5 ? p.y : p.x, v = a.z > 0.5 ? p.y : p.z;
      const double half = solid.size.x;
      surface.albedo = planks(u, v + half, 0.4 * half, 5.0, 21.0 + 3 * n.x + 5 * n.y + 7 * n.z, width,
                              srgb(110, 68, 34), srgb(222, 170, 104));
      const double frame = std::max(std::abs(u), std::abs(v)) - 0.78 * half;
      const double brace = std::abs(u - v) / std::numbers::sqrt2 - 0.11 * half;
      const Vec3 beam = planks(v, u + half, 0.5 * half, 5.0, 33, width, srgb(96, 56, 26), srgb(178, 122, 70));
      const double on_beam = std::max(edge(frame, width), edge(-brace, width));
      surface.albedo = mix(surface.albedo * mix(0.7, 1.0, edge(std::min(-frame, brace) - 0.012, 0.012)), beam, on_beam);
      // Nails.
      const double nail = std::hypot(std::abs(u) - 0.89 * half, std::abs(v) - 0.89 * half);
      surface.albedo = mix(srgb(48, 46, 48), surface.albedo, edge(nail - 0.012, width));
      break;
    }
    case Material::stone: {
      const Vec3 a = glm::abs(n);
      const double u = a.x > 0.5 ? p.y : p.x, v = a.z > 0.5 ? p.y : p.z;
      const double veins = std::abs(fractal(p + Vec3(solid.seed), 0.22, 4, width));
      surface.albedo = mix(srgb(70, 78, 84), srgb(196, 200, 196), std::clamp(0.35 + 1.1 * veins, 0.0, 1.0));
      surface.albedo = mix(srgb(226, 214, 180), surface.albedo, edge(veins - 0.022, 0.03));
      const double x = std::abs(fract(u / 0.12) - 0.5), y = std::abs(fract(v / 0.12) - 0.5);
      surface.albedo *= mix(0.55, 1.0, band(x + y, 0.0, 0.32, width / 0.12) + edge(x + y - 0.4, width / 0.12));
      surface.specular = 0.12;
      break;
    }
    case Material::candy: {
      // Stripes wind around the tube.
      const double tube = std::atan2(p.z, std::hypot(p.x, p.y) - solid.size.x);
      const double phase = fract(angle * 9 / kPi + tube * 1.5 / kPi);
      const double pixel = width / (solid.size.x * kPi / 9);
      surface.albedo = mix(srgb(246, 240, 232), srgb(206, 36, 52), band(phase, 0.0, 0.5, pixel));
      surface.albedo = mix(surface.albedo, srgb(40, 120, 84), band(phase, 0.68, 0.8, pixel));
      surface.albedo *= 1 + 0.12 * fractal(p, 0.05, 3, width);
      surface.specular = 0.3;
      surface.shininess = 60;
      break;
    }
    case Material::bronze: {
      const double patina = fractal(p + Vec3(3.0), 0.12, 4, width);
      surface.albedo = mix(srgb(150, 92, 44), srgb(74, 150, 128), std::clamp(0.4 + 1.5 * patina, 0.0, 1.0));
      const double tube = std::atan2(p.z, std::hypot(p.x, p.y) - solid.size.x);
      const double x = fract(angle * 18 / kPi) - 0.5, y = fract(tube * 3 / kPi) - 0.5;
      const double pixel = width / (solid.size.x * kPi / 18);
      surface.albedo *= mix(0.45, 1.0, edge(std::abs(std::hypot(x, y) - 0.3) - 0.07, pixel));
      surface.specular = 0.3;
      surface.shininess = 24;
      break;
    }
    case Material::spiral: {
      const double phase = fract(angle / (2 * kPi) + p.z / 0.17);
      const double pixel = width / 0.17;
      surface.albedo = mix(srgb(244, 178, 52), srgb(60, 44, 110), band(phase, 0.0, 0.48, pixel));
      const double dots = std::hypot(fract(angle * 8 / kPi) - 0.5, (phase - 0.24) * 2.2);
      surface.albedo =
          mix(surface.albedo, srgb(238, 232, 240), edge(0.26 - dots, 8 * pixel / 2.2) * visible(0.06, width));
      surface.albedo *= 1 + 0.16 * fractal(p, 0.06, 3, width);
      surface.specular = 0.15;
      break;
    }
    case Material::mosaic: {
      const double u = n.z > 0.5 ? p.x : angle * solid.size.x, v = n.z > 0.5 ? p.y : p.z;
      const Cell cell = scattered_cell(u / 0.075, v / 0.075, 13 + solid.seed);
      surface.albedo = palette(cell.tone) * (1 + 0.2 * fractal(p, 0.05, 2, width));
      surface.albedo = mix(srgb(232, 228, 216), surface.albedo, edge(cell.rim - 0.12, width / 0.075));
      surface.specular = 0.2;
      surface.shininess = 50;
      break;
    }
    case Material::can: {
      const double height = solid.size.z, v = p.z / height;
      const double pixel = width / height;
      if (n.z > 0.5) {
        const double rings = std::sin(2 * kPi * std::hypot(p.x, p.y) / 0.035) * visible(0.035, width);
        surface.albedo = srgb(190, 190, 194) * (0.85 + 0.15 * rings);
      } else {
        surface.albedo = srgb(24, 96, 150) * (1 + 0.1 * fractal(p, 0.07, 3, width));
        const double check_u = std::floor(fract(angle / (2 * kPi)) * 24), check_v = std::floor(v * 14);
        const double check = std::fmod(check_u + check_v, 2.0);
        surface.albedo = mix(surface.albedo, mix(srgb(246, 238, 214), srgb(22, 26, 34), check),
                             std::max(band(v, 1.0 / 14, 3.0 / 14, pixel), band(v, 11.0 / 14, 13.0 / 14, pixel)));
        const double x = fract(angle * 2.5 / kPi) - 0.5, y = (v - 0.5) * 1.6;
        const double badge = std::hypot(x, y), rays = std::cos(10 * std::atan2(y, x));
        surface.albedo = mix(surface.albedo, srgb(248, 206, 62), edge(0.26 + 0.07 * rays - badge, 1.6 * pixel));
        surface.albedo = mix(surface.albedo, srgb(206, 52, 44), edge(0.14 - badge, 1.6 * pixel));
        surface.albedo = mix(surface.albedo, srgb(190, 190, 194), edge(std::abs(v - 0.5) - 0.475, pixel));
      }
      surface.specular = 0.3;
      surface.shininess = 40;
      break;
    }
    case Material::marble: {
      const Vec3 q = p + Vec3(5 * solid.seed);
      const double swirl = std::sin(22 * (q.x + 0.6 * q.z) + 7 * fractal(q, 0.22, 4, width));
      surface.albedo =
          mix(palette(fract(0.13 + 0.29 * solid.seed)), srgb(246, 240, 228), std::clamp(0.5 + 0.75 * swirl, 0.0, 1.0));
      surface.specular = 0.32;
      surface.shininess = 70;
      break;
    }
    case Material::column: {
      const double twist = fract(angle * 1.5 / kPi + p.z / 0.9);
      const double pixel = width / (solid.size.x * kPi / 1.5);
      const double veins = fractal(p + Vec3(solid.seed), 0.18, 4, width);
      surface.albedo = mix(srgb(206, 196, 176), srgb(92, 110, 92), band(twist, 0.0, 0.45, pixel)) * (1 + 0.5 * veins);
      surface.albedo = mix(surface.albedo, srgb(196, 148, 66), band(twist, 0.45, 0.52, pixel));
      const double collar = std::max(edge(0.16 - p.z, width), edge(p.z - 2.5, width));
      surface.albedo = mix(surface.albedo, srgb(118, 92, 64) * (1 + 0.4 * veins), collar);
      surface.specular = 0.1;
      break;
    }
    case Material::dice: {
      const Vec3 a = glm::abs(n);
      const double half = solid.size.x;
      const double u = (a.x > 0.5 ? p.y : p.x) / half, v = (a.z > 0.5 ? p.y : p.z) / half;
      surface.albedo = srgb(236, 226, 204) * (1 + 0.14 * fractal(p + Vec3(solid.seed), 0.06, 3, width));
      const int face = (a.x > 0.5 ? 0 : a.y > 0.5 ? 1 : 2) + (n.x + n.y + n.z > 0 ? 3 : 0);
      const auto pip = [&](double x, double y) {
        surface.albedo = mix(srgb(150, 24, 36), surface.albedo, edge(std::hypot(u - x, v - y) - 0.17, width / half));
      };
      constexpr std::array<int, 6> kPips{1, 2, 3, 6, 5, 4};  // opposite faces sum to seven
      const int count = kPips[static_cast<std::size_t>(face)];
      if (count % 2 == 1) pip(0, 0);
      if (count >= 2) pip(-0.5, -0.5), pip(0.5, 0.5);
      if (count >= 4) pip(-0.5, 0.5), pip(0.5, -0.5);
      if (count == 6) pip(-0.5, 0), pip(0.5, 0);
      const double rim = std::max(std::abs(u), std::abs(v));
      surface.albedo *= mix(1.0, 0.6, edge(rim - 0.94, width / half));
      surface.specular = 0.2;
      break;
    }
  }
  return surface;
}

// ------------------------------------------------------------------------------------------------------------- scene

struct Light {
  Vec3 position;
  Vec3 power;
};

struct Shaded {
  Vec3 color{0.0};  // linear, before exposure
  Hit hit;
};

Mat3 turned(double degrees, double tilt_degrees = 0) {
  const auto about = [](double angle, const Vec3& axis) {
    return glm::mat3_cast(glm::angleAxis(angle * kPi / 180, axis));
  };
  return glm::transpose(about(degrees, {0, 0, 1}) * about(tilt_degrees, {1, 0, 0}));
}

class Room final : public World {
 public:
  Room() {
    constexpr double kPodium = 0.16;
    const auto add = [&](Shape shape, Material material, Vec3 size, Vec3 position, Mat3 local_from_world = Mat3(1.0)) {
      Solid solid{shape, material, size, position, local_from_world};
      solid.seed = static_cast<double>(solids_.size());
      Vec3 middle(0.0);
      switch (shape) {
        case Shape::sphere:
          solid.bound_radius = size.x;
          break;
        case Shape::box:
          solid.bound_radius = glm::length(size);
          break;
        case Shape::torus:
          solid.bound_radius = size.x + size.y;
          break;
        case Shape::cylinder:
        case Shape::cone:
          middle = {0, 0, 0.5 * size.z};
          solid.bound_radius = std::hypot(size.x, 0.5 * size.z);
          break;
      }
      solid.bound_centre = position + glm::transpose(local_from_world) * middle;
      solids_.push_back(solid);
    };
    add(Shape::cylinder, Material::podium, {1.18, 0, kPodium}, {0, 0, 0});
    add(Shape::box, Material::stone, Vec3(0.25, 0.25, 0.2), {0.02, 0.05, kPodium + 0.2}, turned(18));
    add(Shape::sphere, Material::globe, Vec3(0.34), {0.02, 0.05, kPodium + 0.4 + 0.34}, turned(40, 23));
    add(Shape::box, Material::crate, Vec3(0.22), {-0.66, -0.3, kPodium + 0.22}, turned(28));
    add(Shape::torus, Material::candy, {0.155, 0.065, 0}, {-0.66, -0.3, kPodium + 0.44 + 0.065}, turned(0));
    add(Shape::cone, Material::spiral, {0.25, 0, 0.7}, {-0.42, 0.62, kPodium});
    add(Shape::cylinder, Material::can, {0.17, 0, 0.44}, {0.62, 0.48, kPodium}, turned(60));
    add(Shape::torus, Material::bronze, {0.27, 0.075, 0}, {0.7, -0.32, kPodium + 0.345}, turned(-35, 90));
    add(Shape::sphere, Material::beach_ball, Vec3(0.2), {0.05, -0.72, kPodium + 0.2}, turned(15, 50));
    add(Shape::cylinder, Material::mosaic, {0.13, 0, 0.28}, {0.12, 0.78, kPodium});
    add(Shape::sphere, Material::marble, Vec3(0.13), {0.12, 0.78, kPodium + 0.28 + 0.13});
    add(Shape::sphere, Material::marble, Vec3(0.1), {-0.24, -0.52, kPodium + 0.1});
    add(Shape::sphere, Material::marble, Vec3(0.08), {0.38, -0.66, kPodium + 0.08});
    add(Shape::box, Material::dice, Vec3(0.085), {-0.78, 0.22, kPodium + 0.085}, turned(52));
    add(Shape::box, Material::dice, Vec3(0.085), {0.86, 0.1, kPodium + 0.085}, turned(11));
    for (const double x : {-2.86, 2.86}) {
      for (const double y : {-2.46, 2.46}) add(Shape::cylinder, Material::column, {0.2, 0, kRoomHigh.z}, {x, y, 0});
    }
    lights_ = {{{1.7, -1.3, 2.35}, Vec3(1.0, 0.87, 0.7) * 8.4}, {{-1.9, 1.2, 2.3}, Vec3(0.7, 0.85, 1.0) * 3.6}};
  }

  Seen probe(const Ray& ray) const override {
    const Hit hit = trace(ray);
    return {hit.distance, hit.normal, hit.solid >= 0, false, Vec3(0.0)};
  }

  Seen look(const Ray& ray, double pixel_angle) const override {
    const Shaded shaded = shade(ray, pixel_angle);
    return {shaded.hit.distance, shaded.hit.normal, shaded.hit.solid >= 0, false, exposed(shaded.color)};
  }

  Pose camera(int index, int count, const RandomStream& random) const override {
    const auto key = static_cast<std::uint64_t>(index) * 8;
    const auto jitter = [&](std::uint64_t k) { return 2 * random.uniform(key + k) - 1; };
    const double turn = (index + 0.35 * jitter(0)) / count;
    const double level = fract(index * 0.61803398875);  // heights spread evenly, neighbours differ
    const double angle = 2 * kPi * turn;
    const double radius = 2.28 - 0.42 * level + 0.1 * jitter(1);
    return looking({radius * std::cos(angle), radius * std::sin(angle), 0.62 + 1.3 * level + 0.06 * jitter(2)},
                   {0.14 * jitter(3), 0.14 * jitter(4), 0.52 + 0.1 * jitter(5)});
  }

 private:
  Hit trace(const Ray& ray) const {
    Hit hit;
    for (int axis = 0; axis < 3; ++axis) {
      if (ray.direction[axis] == 0) continue;
      const bool high = ray.direction[axis] > 0;
      const double distance = ((high ? kRoomHigh : kRoomLow)[axis] - ray.origin[axis]) / ray.direction[axis];
      if (distance < hit.distance) {
        hit.distance = distance;
        hit.wall = 2 * axis + (high ? 1 : 0);
        hit.normal = Vec3(0.0);
        hit.normal[axis] = high ? -1 : 1;
      }
    }
    for (std::size_t i = 0; i < solids_.size(); ++i) {
      if (!comes_near(solids_[i], ray, hit.distance)) continue;
      const LocalHit local = hit_solid(solids_[i], ray);
      if (local.distance < hit.distance) {
        hit.distance = local.distance;
        hit.solid = static_cast<int>(i);
        hit.normal = glm::transpose(solids_[i].local_from_world) * local.normal;
      }
    }
    return hit;
  }

  /// @param pixel_angle size of a sample in radians
  Shaded shade(const Ray& ray, double pixel_angle) const {
    Shaded result;
    const Hit& hit = result.hit = trace(ray);
    const Vec3 p = ray.origin + hit.distance * ray.direction;
    const Vec3 view = -ray.direction;
    const double facing = std::max(0.25, std::abs(glm::dot(hit.normal, view)));
    const double width = hit.distance * pixel_angle / facing;
    const Surface surface = surface_at(hit, p, width);

    const double open = openness(hit, p);
    const Vec3 sky = mix(srgb(150, 124, 104), srgb(214, 220, 230), 0.5 + 0.5 * hit.normal.z);
    Vec3 color = surface.albedo * sky * (0.36 * open);
    for (const Light& light : lights_) {
      const Vec3 to_light = light.position - p;
      const double distance = glm::length(to_light);
      const Vec3 direction = to_light / distance;
      const double cosine = glm::dot(hit.normal, direction);
      if (cosine <= 0) continue;
      const double lit = light_seen(p + 1e-5 * hit.normal, light.position);
      if (lit <= 0) continue;
      const Vec3 arriving = light.power * (lit / (1.2 + distance * distance));
      const double gleam =
          std::pow(std::max(0.0, glm::dot(hit.normal, glm::normalize(direction + view))), surface.shininess);
      color += arriving * (surface.albedo * cosine + surface.specular * gleam);
    }
    result.color = color;
    return result;
  }

  static Vec3 exposed(const Vec3& color) {
    return {1 - std::exp(-1.25 * color.x), 1 - std::exp(-1.25 * color.y), 1 - std::exp(-1.25 * color.z)};
  }

  Surface surface_at(const Hit& hit, const Vec3& p, double width) const {
    if (hit.solid >= 0) {
      const Solid& solid = solids_[static_cast<std::size_t>(hit.solid)];
      return solid_surface(solid, solid.local_from_world * (p - solid.position), solid.local_from_world * hit.normal,
                           width);
    }
    if (hit.wall < 4) return wall_surface(hit.wall, p, width);
    return hit.wall == 4 ? floor_surface(p, width) : ceiling_surface(p, width);
  }

  /// Share of a small spherical lamp that a point sees: a fixed pattern of rays, the same for every view.
  double light_seen(const Vec3& from, const Vec3& to) const {
    constexpr double kLampRadius = 0.07;
    constexpr std::array<Vec3, 3> kPattern{Vec3{0.9, 0.1, -0.4}, Vec3{-0.5, 0.75, 0.4}, Vec3{-0.35, -0.85, 0.0}};
    // Few solids come near the bundle of rays; most points have none.
    const Vec3 middle_way = to - from;
    const double length = glm::length(middle_way);
    const Vec3 middle = middle_way / length;
    std::array<const Solid*, kMostSolids> near;
    std::size_t count = 0;
    for (const Solid& solid : solids_) {
      const Vec3 to_centre = solid.bound_centre - from;
      const double along = glm::dot(to_centre, middle);
      const double reach = solid.bound_radius + kLampRadius;
      if (along < -reach || along > length + reach) continue;
      if (glm::dot(to_centre, to_centre) - along * along < reach * reach) near[count++] = &solid;
    }
    if (count == 0) return 1;
    double seen = 0;
    for (const Vec3& offset : kPattern) {
      const Vec3 way = to + kLampRadius * offset - from;
      const double distance = glm::length(way);
      const Ray ray{from, way / distance};
      const bool blocked =
          std::any_of(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(count), [&](const Solid* solid) {
            return comes_near(*solid, ray, distance) && hit_solid(*solid, ray).distance < distance;
          });
      if (!blocked) seen += 1.0 / static_cast<double>(kPattern.size());
    }
    return seen;
  }

  /// Ambient light that reaches a point: less in the corners of the room and beside solids (as if they were spheres).
  double openness(const Hit& hit, const Vec3& p) const {
    double open = 1;
    for (int axis = 0; axis < 3; ++axis) {
      for (const double distance : {p[axis] - kRoomLow[axis], kRoomHigh[axis] - p[axis]}) {
        if (hit.solid < 0 && hit.wall / 2 == axis) continue;  // not its own wall
        open *= 1 - 0.42 / (1 + distance * distance * 40);
      }
    }
    for (std::size_t i = 1; i < solids_.size(); ++i) {  // 0 is the podium: too flat for a sphere
      if (static_cast<int>(i) == hit.solid) continue;
      const Vec3 to = solids_[i].bound_centre - p;
      const double radius = 0.8 * solids_[i].bound_radius;
      const double height = glm::dot(hit.normal, to);
      if (height <= 0) continue;
      const double square = std::max(glm::dot(to, to), radius * radius);
      open *= 1 - 0.75 * height * radius * radius / (square * std::sqrt(square));
    }
    return open;
  }

  static constexpr std::size_t kMostSolids = 32;
  std::vector<Solid> solids_;  // at most kMostSolids
  std::vector<Light> lights_;
};

// ----------------------------------------------------------------------------------------------------------- cameras

struct Intrinsics {
  int width, height;
  double focal, cx, cy;

  Ray ray(const Pose& pose, double x, double y) const {
    return {pose.centre, glm::normalize(pose.world_from_camera * Vec3((x - cx) / focal, (y - cy) / focal, 1.0))};
  }
};

struct Picture {
  std::vector<std::uint8_t> color;    // RGB
  std::vector<std::uint16_t> depth;   // mm of z
  std::vector<std::uint8_t> normals;  // RGB
  std::vector<std::uint8_t> mask;
};

constexpr double kFarthestDepth = 65.5;  // what 16 bits of millimetres can hold

void render_rows(const World& world, const Intrinsics& camera, const Pose& pose, int samples, std::size_t begin,
                 std::size_t end, Picture& picture) {
  const double pixel_angle = 1.0 / camera.focal;
  for (std::size_t row = begin; row < end; ++row) {
    for (int column = 0; column < camera.width; ++column) {
      Vec3 sum(0.0);
      for (int j = 0; j < samples; ++j) {
        for (int i = 0; i < samples; ++i) {
          const double x = column + (i + 0.5) / samples, y = static_cast<double>(row) + (j + 0.5) / samples;
          sum += world.look(camera.ray(pose, x, y), pixel_angle).color;
        }
      }
      sum /= static_cast<double>(samples * samples);
      const Ray ray = camera.ray(pose, column + 0.5, static_cast<double>(row) + 0.5);
      const Seen seen = world.probe(ray);
      const double z = seen.distance * glm::dot(ray.direction, pose.world_from_camera[2]);
      const std::size_t pixel = row * static_cast<std::size_t>(camera.width) + static_cast<std::size_t>(column);
      for (int c = 0; c < 3; ++c) {
        const std::size_t at = 3 * pixel + static_cast<std::size_t>(c);
        picture.color[at] = encode_srgb(sum[c]);
        picture.normals[at] = static_cast<std::uint8_t>(std::lround(127.5 * (seen.normal[c] + 1)));
      }
      const bool measured = !seen.sky && z < kFarthestDepth;
      picture.depth[pixel] = measured ? static_cast<std::uint16_t>(std::lround(1000 * z)) : std::uint16_t{0};
      picture.mask[pixel] = seen.object ? 255 : 0;
    }
  }
}

std::unique_ptr<World> make_world(const std::string& scene) {
  if (scene == "street") return make_street();
  return std::make_unique<Room>();
}

void check(const SynthOptions& options) {
  const auto require = [](bool good, const std::string& cause) {
    if (!good) throw InputError("synth: " + cause);
  };
  require(!options.output.empty(), "no output folder is given");
  require(options.scene == "room" || options.scene == "street",
          "there is no scene '" + options.scene + "'; there is: room, street");
  require(options.width >= 16 && options.height >= 16 && options.width <= 8192 && options.height <= 8192,
          "the size " + std::to_string(options.width) + "x" + std::to_string(options.height) +
              " is not possible; both sides must lie in 16 to 8192");
  require(options.views >= 1 && options.views <= 9999,
          std::to_string(options.views) + " views are not possible; use 1 to 9999");
  require(options.points >= 0, std::to_string(options.points) + " points are not possible; use 0 or more");
  require(options.samples >= 1 && options.samples <= 16,
          std::to_string(options.samples) + " samples are not possible; use 1 to 16");
  require(std::isfinite(options.point_noise) && options.point_noise >= 0,
          "the point noise must be a finite number, 0 or more");
  std::error_code error;
  require(!std::filesystem::exists(options.output, error) || std::filesystem::is_directory(options.output, error),
          options.output.string() + " is not a folder");
}

}  // namespace

void write_synthetic_scene(const SynthOptions& options) {
  check(options);
  for (const char* folder : {"images", "sparse/0", "depth", "normals", "masks"}) {
    std::error_code error;
    std::filesystem::create_directories(options.output / folder, error);
    if (error) throw InputError((options.output / folder).string() + ": the folder cannot be made: " + error.message());
  }

  const std::unique_ptr<const World> world = make_world(options.scene);
  const RandomStream camera_random(options.seed, 0, RandomPurpose::synth);
  const RandomStream point_random(options.seed, 1, RandomPurpose::synth);
  const Intrinsics camera{options.width, options.height, 0.5 * options.width / std::tan(0.5 * kFieldOfView),
                          0.5 * options.width, 0.5 * options.height};
  std::vector<Pose> poses;
  for (int i = 0; i < options.views; ++i) poses.push_back(world->camera(i, options.views, camera_random));

  ColmapModel model;
  model.cameras.push_back({1,
                           1,
                           static_cast<std::uint64_t>(camera.width),
                           static_cast<std::uint64_t>(camera.height),
                           {camera.focal, camera.focal, camera.cx, camera.cy}});
  Threads threads;
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  Picture picture{std::vector<std::uint8_t>(3 * pixels), std::vector<std::uint16_t>(pixels),
                  std::vector<std::uint8_t>(3 * pixels), std::vector<std::uint8_t>(pixels)};
  for (int i = 0; i < options.views; ++i) {
    const Pose& pose = poses[static_cast<std::size_t>(i)];
    threads.for_range(static_cast<std::size_t>(camera.height), 4, [&](std::size_t begin, std::size_t end) {
      render_rows(*world, camera, pose, options.samples, begin, end, picture);
    });
    char name[16];
    std::snprintf(name, sizeof(name), "%04d.png", i);
    const auto bytes = [](const std::vector<std::uint8_t>& values) { return std::span<const std::uint8_t>(values); };
    write_png(options.output / "images" / name, camera.width, camera.height, 3, bytes(picture.color));
    write_png(options.output / "depth" / name, camera.width, camera.height, 1,
              std::span<const std::uint16_t>(picture.depth));
    write_png(options.output / "normals" / name, camera.width, camera.height, 3, bytes(picture.normals));
    write_png(options.output / "masks" / name, camera.width, camera.height, 1, bytes(picture.mask));

    const Mat3 rotation = glm::transpose(pose.world_from_camera);
    const glm::dquat quaternion = glm::quat_cast(rotation);
    const Vec3 translation = -(rotation * pose.centre);
    ColmapImage image;
    image.id = static_cast<std::uint32_t>(i + 1);
    image.camera_id = 1;
    image.name = name;
    const std::array<double, 4> wxyz{quaternion.w, quaternion.x, quaternion.y, quaternion.z};
    std::copy(wxyz.begin(), wxyz.end(), image.rotation);
    for (int k = 0; k < 3; ++k) image.translation[k] = translation[k];
    model.images.push_back(std::move(image));
  }

  // The sparse cloud: what random pixels of random views see, off by some noise, as triangulated points are.
  const auto points = static_cast<std::size_t>(options.points);
  model.points.positions.resize(3 * points);
  model.points.colors.resize(3 * points);
  for (std::size_t i = 0; i < points; ++i) {
    const std::uint64_t key = 16 * i;
    const Pose& pose = poses[point_random.below(key, poses.size())];
    const Ray ray =
        camera.ray(pose, camera.width * point_random.uniform(key + 1), camera.height * point_random.uniform(key + 2));
    const Seen seen = world->look(ray, 1.0 / camera.focal);
    for (int k = 0; k < 3; ++k) {
      const std::size_t at = 3 * i + static_cast<std::size_t>(k);
      // normal(n) uses the numbers 2n and 2n + 1: here 16i + 4 … 16i + 9.
      const double off =
          static_cast<double>(options.point_noise) * point_random.normal(8 * i + 2 + static_cast<std::uint64_t>(k));
      model.points.positions[at] = static_cast<float>((ray.origin + seen.distance * ray.direction)[k] + off);
      model.points.colors[at] = encode_srgb(seen.color[k]);
    }
  }
  write_colmap_model(options.output / "sparse" / "0", model);
}

}  // namespace splatboost
