// SPDX-License-Identifier: Apache-2.0
/// @file What the street and the things in it look like from close by.
#pragma once

#include <cmath>

#include "trainer/synth/synth_world.h"

namespace splatboost::synthetic::street {

// Metres across the street from its middle, and along it.
inline constexpr double kRoad = 3.5;      // half width
inline constexpr double kPavement = 6.0;  // its outer edge
inline constexpr double kFronts = 8.0;    // of the houses
inline constexpr double kLot = 8.5;       // width of a house's ground

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

/// A number in [0, 1) of a thing, another one for each purpose.
inline double seeded(double seed, double purpose) { return hash01(std::floor(seed), std::floor(purpose), 77.0); }

/// @param p point in the solid's own frame
/// @param n normal there
/// @param width of a pixel there
Surface surface_of(const Solid& solid, const Vec3& p, const Vec3& n, double width);
/// @param p point in the world
Surface ground(const Vec3& p, double width);
/// Linear colour. @param direction unit
Vec3 sky_color(const Vec3& direction);

}  // namespace splatboost::synthetic::street
