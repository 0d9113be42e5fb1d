// SPDX-License-Identifier: Apache-2.0
#include "trainer/synth/synth_street_surfaces.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace splatboost::synthetic::street {
namespace {

Vec3 plaster_color(double seed) {
  static const std::array<Vec3, 6> kColors{srgb(232, 214, 178), srgb(198, 130, 98),  srgb(176, 192, 170),
                                           srgb(222, 180, 110), srgb(160, 182, 204), srgb(226, 204, 200)};
  return kColors[static_cast<std::size_t>(seeded(seed, 1) * 5.999)];
}

/// A window of half size (0.48, 0.68) around the origin; returns how much of the wall it covers.
double window(double u, double v, double seed, double width, Vec3& color) {
  constexpr double kHalfU = 0.48, kHalfV = 0.68;
  const double outside = std::max(std::abs(u) - kHalfU, std::abs(v) - kHalfV);
  const double sill = std::max(std::abs(u) - kHalfU - 0.14, std::abs(v + kHalfV + 0.12) - 0.04);
  const bool shutters = seeded(seed, 9) > 0.45;
  const double shutter = shutters ? std::max(std::abs(std::abs(u) - kHalfU - 0.29) - 0.17, std::abs(v) - kHalfV) : 1.0;
  // Glass: the sky above, the room below, curtains at the sides.
  const Vec3 sky = mix(srgb(70, 92, 116), srgb(176, 202, 222), std::clamp(0.5 + v, 0.0, 1.0));
  Vec3 glass = mix(srgb(26, 30, 36), sky, 0.35 + 0.3 * fractal({u * 2, v * 2, seed}, 0.7, 3, 2 * width));
  const double hem = 0.2 + 0.12 * std::sin(v * 5 + seed) + 0.1 * seeded(seed, 4);
  const Vec3 cloth = palette(seeded(seed, 5)) * (0.55 + 0.45 * std::cos(2 * kPi * u / 0.08) * visible(0.08, width));
  glass = mix(glass, mix(srgb(220, 214, 204), cloth, 0.5), 0.8 * edge(std::abs(u) - kHalfU + hem, width));
  const double bars = std::min({std::abs(u) - 0.02, std::abs(v) - 0.02, std::abs(v - 0.36) - 0.015});
  const Vec3 frame = srgb(240, 238, 230) * (1 + 0.06 * fractal({u, v, seed}, 0.05, 2, width));
  Vec3 inside = mix(frame, glass, std::min(edge(bars, width), edge(-outside - 0.06, width)));
  color = mix(color, inside, edge(-outside, width));
  if (shutters) {
    const double slats = 0.75 + 0.25 * std::sin(2 * kPi * v / 0.09) * visible(0.09, width);
    color = mix(color, palette(seeded(std::floor(seed / 16), 8)) * 0.7 * slats, edge(-shutter, width));
  }
  color = mix(color, srgb(206, 200, 188), edge(-sill, width));
  return edge(-outside, width);
}

void door(double u, double v, double seed, double width, Vec3& color) {
  const double outside = std::max(std::abs(u) - 0.52, std::abs(v - 1.05) - 1.05);
  const Vec3 paint = mix(palette(seeded(seed, 6)), srgb(60, 40, 30), 0.35);
  Vec3 leaf = paint * (0.9 + 0.2 * fractal({u, v * 0.2, seed}, 0.04, 3, width));
  const double panel_u = std::abs(std::abs(u) - 0.23) - 0.16, panel_v = std::abs(fract(v / 0.68) - 0.5) * 0.68 - 0.26;
  const double panel = std::max(panel_u, panel_v);
  leaf *= mix(1.0, 0.55, band(panel, -0.025, 0.0, width));
  leaf = mix(leaf, srgb(220, 180, 90), edge(0.035 - std::hypot(u - 0.42, v - 1.0), width));
  const double number = std::hypot(std::fmod(std::abs(u), 0.12) - 0.06, v - 1.72) - 0.035;
  leaf = mix(leaf, srgb(240, 226, 170), edge(-number, width) * edge(0.14 - std::abs(u), width));
  color = mix(color, srgb(226, 220, 206), edge(0.14 - outside, width) * edge(v, width));
  color = mix(color, leaf, edge(-outside, width));
}

Vec3 wall(const Solid& solid, const Vec3& p, const Vec3& n, double width) {
  const bool front = std::abs(n.y) > 0.5;
  const double half = front ? solid.size.x : solid.size.y;
  const double u = front ? p.x : p.y, v = p.z + solid.size.z;
  const double kind = seeded(solid.seed, 2);
  Vec3 color;
  if (kind < 0.4) {
    color = plaster_color(solid.seed) * (1 + 0.22 * fractal(p + Vec3(solid.seed), 0.5, 6, width));
    color = mix(color, color * 0.75, edge(0.35 + 0.12 * fractal({u, 1, solid.seed}, 0.8, 3, width) - v, width));
  } else if (kind < 0.75) {
    color = bricks(u, v, solid.seed, width);
  } else {
    color = planks(u, v, 0.19, 2.6, solid.seed, width, plaster_color(solid.seed) * 0.7, plaster_color(solid.seed));
  }
  // A plinth, quoins at the corners, and rows of windows; the door replaces the middle one of the ground floor.
  color = mix(color, srgb(150, 146, 138) * (1 + 0.3 * fractal(p, 0.12, 4, width)), edge(0.42 - v, width));
  const double quoin = 0.28 + 0.1 * (std::fmod(std::floor(v / 0.36), 2.0));
  const Vec3 stone = srgb(206, 198, 182) * (1 + 0.2 * fractal(p, 0.1, 3, width)) *
                     mix(0.6, 1.0, edge(std::abs(fract(v / 0.36) - 0.5) * -0.36 + 0.165, width));
  color = mix(color, stone, edge(std::abs(u) - (half - quoin), width));
  const int columns = std::max(1, static_cast<int>(2 * half / 2.1));
  const int floors = std::max(1, static_cast<int>(2 * solid.size.z / 2.7));
  const double column = std::clamp(std::floor((u / half + 1) * 0.5 * columns), 0.0, columns - 1.0);
  const double storey = std::clamp(std::floor(v / (2 * solid.size.z) * floors), 0.0, floors - 1.0);
  const double centre_u = half * (2 * (column + 0.5) / columns - 1);
  const double centre_v = 2 * solid.size.z * (storey + 0.5) / floors + 0.12;
  const bool is_door = front && storey == 0 && column == std::floor(columns / 2.0);
  if (is_door) {
    door(u - centre_u, v, solid.seed, width, color);
  } else {
    window(u - centre_u, v - centre_v, 16 * solid.seed + 5 * column + storey + (front ? 0 : 3), width, color);
  }
  color = mix(color, srgb(224, 218, 204), edge(v - 2 * solid.size.z + 0.16, width));
  return color;
}

Vec3 tiles(const Solid& solid, const Vec3& p, const Vec3& n, double width) {
  if (std::abs(n.x) > 0.5) {  // the gable's triangle
    return planks(p.z, p.y, 0.2, 9.0, solid.seed, width, plaster_color(solid.seed) * 0.6,
                  plaster_color(solid.seed) * 0.9);
  }
  const double down = std::hypot(std::abs(p.y), solid.size.z - p.z);
  constexpr double kRow = 0.3, kTile = 0.24;
  const double row = std::floor(down / kRow);
  const double u = p.x + 0.5 * kTile * std::fmod(row, 2.0);
  const double tone = hash01(row, std::floor(u / kTile), solid.seed + 3);
  const bool slate = seeded(solid.seed, 3) > 0.55;
  Vec3 color =
      slate ? mix(srgb(66, 72, 84), srgb(120, 126, 136), tone) : mix(srgb(132, 60, 44), srgb(196, 106, 74), tone);
  const double across = fract(u / kTile) - 0.5;
  const double lip = fract(down / kRow) + 0.35 * across * across - 0.88;
  color *= 1 - 0.5 * edge(lip, width / kRow) * visible(kRow, width);
  color *= 1 - 0.35 * edge(std::abs(across) - 0.46, width / kTile) * visible(kTile, width);
  return color * (1 + 0.25 * fractal(p, 0.5, 4, width));
}

}  // namespace

Surface surface_of(const Solid& solid, const Vec3& p, const Vec3& n, double width) {
  Surface s;
  const double angle = std::atan2(p.y, p.x);
  switch (solid.material) {
    case Material::house:
      s.albedo = wall(solid, p, n, width);
      break;
    case Material::roof:
      s.albedo = tiles(solid, p, n, width);
      break;
    case Material::leaves: {
      const double clump = fractal(p + Vec3(solid.seed), 0.42, 6, width);
      const double leaf = fractal(p + Vec3(2 * solid.seed), 0.07, 3, width);
      s.albedo = mix(srgb(30, 62, 24), srgb(140, 172, 70), std::clamp(0.45 + 1.2 * clump + 0.8 * leaf, 0.0, 1.0));
      const Vec3 bloom = palette(seeded(solid.seed, 12));
      const Cell cell = scattered_cell(angle * 3, p.z * 9 / (0.3 + solid.size.x), solid.seed);
      if (solid.size.x < 0.5) s.albedo = mix(s.albedo, bloom, edge(cell.rim - 0.45, 9 * width));
      s.specular = 0;
      break;
    }
    case Material::bark:
      s.albedo = mix(srgb(62, 46, 34), srgb(128, 104, 80),
                     std::clamp(0.5 + fractal({angle * 0.6, p.z * 0.25, solid.seed}, 0.12, 5, width), 0.0, 1.0));
      break;
    case Material::metal:
      s.albedo = srgb(54, 64, 62) * (1 + 0.15 * fractal(p, 0.1, 3, width));
      s.albedo = mix(s.albedo, srgb(196, 160, 80), band(p.z, 1.0, 1.08, width));
      s.specular = 0.15;
      break;
    case Material::lamp:
      s.albedo =
          srgb(250, 240, 206) * mix(1.0, 0.4, edge(0.02 - std::abs(std::fmod(std::abs(p.z), 0.1) - 0.05), width));
      break;
    case Material::car: {
      s.albedo = palette(seeded(solid.seed, 13)) * 0.9;
      const bool cabin = solid.size.z < 0.29;
      if (cabin && std::abs(n.z) < 0.5) {
        const double u = std::abs(n.y) > 0.5 ? p.x / solid.size.x : p.y / solid.size.y, v = p.z / solid.size.z;
        const double pane = std::max(std::abs(std::abs(u) - 0.48) - 0.4, std::abs(v) - 0.75);
        s.albedo = mix(s.albedo, mix(srgb(24, 28, 34), srgb(120, 140, 156), 0.5 + 0.4 * v), edge(-pane, width * 2));
      } else if (!cabin) {
        s.albedo *= mix(1.0, 0.5, band(p.z, -0.02, 0.01, width));
        s.albedo *= mix(1.0, 0.4, edge(0.012 - std::abs(std::abs(p.x) - 0.45), width));
        const double light = std::hypot(std::abs(p.y) - 0.62, p.z - 0.12) - 0.13;
        if (std::abs(n.x) > 0.5)
          s.albedo = mix(s.albedo, p.x > 0 ? srgb(250, 246, 226) : srgb(190, 24, 20), edge(-light, width));
      }
      s.specular = 0.25;
      s.shininess = 60;
      break;
    }
    case Material::tyre: {
      const double radius = std::hypot(p.x, p.y);
      s.albedo = srgb(32, 32, 34);
      const double spokes = std::cos(5 * angle);
      if (std::abs(n.z) > 0.5)
        s.albedo = mix(s.albedo, srgb(170, 172, 178) * (0.75 + 0.25 * spokes), edge(0.2 - radius, width));
      break;
    }
    case Material::fence: {
      const double picket = std::abs(fract(p.x / 0.16) - 0.5) * 0.16;
      s.albedo = srgb(236, 232, 222) * (1 + 0.12 * fractal(p, 0.1, 4, width));
      s.albedo = mix(s.albedo, srgb(70, 92, 52), edge(0.018 - picket, width) * visible(0.16, width));
      s.albedo *= mix(1.0, 0.8, band(p.z, 0.12, 0.2, width));
      break;
    }
    case Material::pot: {
      const double zig = std::abs(fract(angle * 6 / kPi) - 0.5) * 0.12;
      s.albedo = mix(srgb(176, 92, 60), srgb(232, 208, 172), band(p.z, 0.12 + zig, 0.17 + zig, width));
      s.albedo *= 1 + 0.2 * fractal(p, 0.06, 3, width);
      break;
    }
    case Material::letterbox: {
      s.albedo = palette(seeded(solid.seed, 14)) * (1 + 0.1 * fractal(p, 0.08, 3, width));
      const double slot = std::max(std::abs(p.x) - 0.12, std::abs(p.z - 0.07) - 0.012);
      s.albedo = mix(s.albedo, srgb(16, 16, 18), edge(-slot, width));
      const double horn = std::abs(std::hypot(p.x, p.z + 0.05) - 0.05) - 0.012;
      s.albedo = mix(s.albedo, srgb(30, 26, 20), edge(-horn, width));
      break;
    }
    case Material::bench:
      s.albedo = planks(p.x, p.y + 3, 0.09, 4.0, solid.seed, width, srgb(92, 58, 34), srgb(170, 118, 70));
      break;
  }
  return s;
}

Surface ground(const Vec3& p, double width) {
  Surface s;
  s.specular = 0;
  const double across = std::abs(p.y);
  const double grain = fractal(p, 0.5, 6, width);
  const Vec3 asphalt = mix(srgb(64, 66, 70), srgb(112, 112, 114), std::clamp(0.45 + 0.55 * grain, 0.0, 1.0));
  Vec3 road = asphalt * (1 + 0.6 * fractal(p, 0.05, 3, width));
  const double patch = fractal({p.x, p.y, 4}, 2.4, 2, width);
  road *= mix(1.0, 0.72, edge(patch - 0.22, width + 0.02));
  const double dash = band(fract(p.x / 3.0) * 3.0, 0.4, 1.9, width) * edge(0.07 - across, width);
  const double line = band(across, kRoad - 0.32, kRoad - 0.2, width);
  road = mix(road, srgb(232, 230, 220) * (1 + 0.25 * grain), std::max(dash, line));
  // A zebra crossing in the middle, and manhole covers at intervals.
  if (std::abs(p.x) < 1.6) {
    const double stripe = band(fract(p.y / 0.9), 0.0, 0.5, width / 0.9) * edge(1.5 - std::abs(p.x), width);
    road = mix(road, srgb(236, 234, 226) * (1 + 0.2 * grain), stripe * edge(kRoad - 0.4 - across, width));
  }
  const double cover_x = (fract(p.x / 13 + 0.3) - 0.5) * 13, cover = std::hypot(cover_x, p.y - 1.1);
  if (cover < 0.4) {
    const double ribs = std::sin(2 * kPi * cover_x / 0.07) * std::sin(2 * kPi * p.y / 0.07) * visible(0.07, width);
    road = mix(road, srgb(78, 72, 66) * (1 + 0.5 * ribs), edge(0.36 - cover, width));
  }
  const double slab_x = fract(p.x / 0.8) * 0.8, slab_y = fract((across - kRoad) / 0.8) * 0.8;
  const double joint = std::min(std::min(slab_x, 0.8 - slab_x), std::min(slab_y, 0.8 - slab_y));
  const double tone = hash01(std::floor(p.x / 0.8), std::floor(p.y / 0.8), 5.0);
  Vec3 pavement = mix(srgb(150, 144, 134), srgb(196, 190, 178), std::clamp(tone + 0.5 * grain, 0.0, 1.0));
  pavement *= mix(0.55, 1.0, edge(joint - 0.012, std::max(width, 0.01)));
  pavement = mix(pavement, srgb(206, 202, 194), band(across, kRoad, kRoad + 0.16, width));
  const double blades = fractal(p, 0.14, 4, width), meadow = fractal({p.x, p.y, 9}, 3.2, 4, width);
  Vec3 grass = mix(srgb(46, 78, 28), srgb(134, 156, 62), std::clamp(0.45 + 0.5 * blades + 0.5 * meadow, 0.0, 1.0));
  const Cell flower = scattered_cell(p.x * 2.2, p.y * 2.2, 4);
  grass = mix(grass, palette(flower.tone), 0.9 * edge(flower.rim - 0.62, 4 * width) * visible(0.3, width));
  // Paths to the doors.
  const double path = std::abs(fract(p.x / kLot + 0.5) - 0.5) * kLot;
  if (across < kFronts) {
    const Cell cobble = scattered_cell(p.x * 7, p.y * 7, 8);
    const Vec3 stones =
        mix(srgb(96, 90, 82), srgb(190, 180, 164) * (0.7 + 0.5 * cobble.tone), edge(cobble.rim - 0.12, 7 * width));
    grass = mix(grass, stones, edge(0.6 - path, width));
  }
  s.albedo = mix(mix(road, pavement, edge(across - kRoad, width)), grass, edge(across - kPavement, width));
  return s;
}

Vec3 sky_color(const Vec3& direction) {
  const double up = std::max(direction.z, 0.0);
  Vec3 color = mix(srgb(214, 226, 234), srgb(86, 140, 206), std::clamp(1.5 * up + 0.05, 0.0, 1.0));
  const Vec3 flat = direction * 5.0;
  const double cloud = fractal(flat + Vec3(2), 2.0, 5, 0.02);
  color = mix(color, srgb(250, 248, 244), std::clamp(1.3 * cloud + 0.12, 0.0, 0.85) * std::min(1.0, 4 * up));
  // Hills behind the meadows.
  const double turn = std::atan2(direction.y, direction.x);
  for (int ridge = 0; ridge < 3; ++ridge) {
    const Vec3 at(std::cos(turn) * 3, std::sin(turn) * 3, 4.0 * ridge);
    const double height = 0.12 - 0.03 * ridge + 0.07 * fractal(at, 1.1, 5, 0.01);
    const Vec3 hill =
        mix(srgb(150, 172, 184), srgb(76, 112, 84), ridge / 2.0) * (1 + 0.3 * fractal(direction * 40.0, 2.0, 3, 0.1));
    color = mix(color, hill, edge(height - direction.z, 0.004));
  }
  return color;
}

}  // namespace splatboost::synthetic::street
