// SPDX-License-Identifier: Apache-2.0
/// @file Solids of the street, and the surface materials of the street and its solids.
#pragma once

#include <cmath>

#include "trainer/synth/synth_world.h"

namespace splatboost::synthetic::street {

// Metres: distances across the street from its middle; kLot is along it.
inline constexpr double kRoad = 3.5;      // half width
inline constexpr double kPavement = 6.0;  // outer edge of the pavement
inline constexpr double kFronts = 8.0;    // fronts of the houses
inline constexpr double kLot = 8.5;       // width of the ground of a house

enum class Shape { box, gable, sphere, cylinder };
enum class Material { house, roof, leaves, bark, metal, lamp, car, tyre, fence, pot, letterbox, bench };

/// Boxes and spheres around their origin; gables and cylinders up from z = 0.
struct Solid {
  Shape shape;
  Material material;
  Vec3 size;  // box: half sides; gable: half sides of the base and height; sphere: radius; cylinder: radius, -, height
  Vec3 position;
  Mat3 local_from_world{1.0};
  double seed = 0;
  Vec3 bound_centre{0.0};
  double bound_radius = 0;
};

/// A random number in [0, 1) that depends on the solid's seed and on the purpose.
inline double seeded(double seed, double purpose) { return hash01(std::floor(seed), std::floor(purpose), 77.0); }

/// @param p point in the solid's own frame
/// @param n normal at p
/// @param width of a pixel at p, metres
Surface surface_of(const Solid& solid, const Vec3& p, const Vec3& n, double width);
/// @param p point in the world
Surface ground(const Vec3& p, double width);
/// Linear colour. @param direction unit
Vec3 sky_color(const Vec3& direction);

}  // namespace splatboost::synthetic::street
