// SPDX-License-Identifier: Apache-2.0
/// @file Solids of the room, and the surface materials of the room and its solids.
#pragma once

#include <memory>
#include <vector>

#include "trainer/synth/synth_world.h"

namespace splatboost::synthetic::room {

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
  Vec3 bound_centre{0.0};  // of the bounding sphere, world
  double bound_radius = 0;
  double seed = 0;  // varies the texture between solids of one material
};

/// @param local_from_world rotation of the solid
Solid make_solid(Shape shape, Material material, Vec3 size, Vec3 position, Mat3 local_from_world = Mat3(1.0));

/// local_from_world of a solid that is tilted about its x axis, then turned about z.
Mat3 turned(double degrees, double tilt_degrees = 0);

/// The room with these solids, at most 32 of them; the first is the podium.
std::unique_ptr<World> make_room_of(std::vector<Solid> solids);

inline constexpr double kPodiumHeight = 0.16;
inline constexpr double kRoomHeight = 2.7;

/// @param wall 0/1: x low/high, 2/3: y low/high
/// @param p point in the world
/// @param width of a pixel at p, metres
Surface wall_surface(int wall, const Vec3& p, double width);
Surface floor_surface(const Vec3& p, double width);
Surface ceiling_surface(const Vec3& p, double width);
/// @param p point in the solid's own frame
/// @param n normal at p
Surface solid_surface(const Solid& solid, const Vec3& p, const Vec3& n, double width);

}  // namespace splatboost::synthetic::room
