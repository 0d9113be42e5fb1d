// SPDX-License-Identifier: Apache-2.0
#include "trainer/synth/synth_room_surfaces.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace splatboost::synthetic::room {
namespace {

constexpr double kRugRadius = 1.78;

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

/// Draws a framed picture around (centre_u, centre_v); returns whether the point (u, v) lies on it.
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

}  // namespace

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
    const double arc = radius * kPi / 18;  // length of one zigzag, for the width of its blur
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

}  // namespace splatboost::synthetic::room
