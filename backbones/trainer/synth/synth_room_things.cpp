// SPDX-License-Identifier: Apache-2.0
// The solids of the room, and their construction.
#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include <glm/gtc/quaternion.hpp>

#include "trainer/synth/synth_room_surfaces.h"

namespace splatboost::synthetic {
namespace room {

Solid make_solid(Shape shape, Material material, Vec3 size, Vec3 position, Mat3 local_from_world) {
  Solid solid{shape, material, size, position, local_from_world};
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
  return solid;
}

Mat3 turned(double degrees, double tilt_degrees) {
  const auto about = [](double angle, const Vec3& axis) {
    return glm::mat3_cast(glm::angleAxis(angle * kPi / 180, axis));
  };
  return glm::transpose(about(degrees, {0, 0, 1}) * about(tilt_degrees, {1, 0, 0}));
}

}  // namespace room

using namespace room;

namespace {

/// The podium and what stands on it.
std::vector<Solid> podium_with_things() {
  std::vector<Solid> solids;
  const auto add = [&](Shape shape, Material material, Vec3 size, Vec3 position, Mat3 local_from_world = Mat3(1.0)) {
    solids.push_back(make_solid(shape, material, size, position, local_from_world));
  };
  constexpr double kPodium = kPodiumHeight;
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
  return solids;
}

/// What stands on the podium, in the light of the room, but in front of a plain backdrop. The cameras are around and
/// above it.
class PodiumAlone final : public World {
 public:
  explicit PodiumAlone(const Vec3& backdrop) : backdrop_(backdrop) {}

  Seen probe(const Ray& ray) const override { return without_room(lit_->probe(ray)); }
  Seen look(const Ray& ray, double pixel_angle) const override { return without_room(lit_->look(ray, pixel_angle)); }

  Pose camera(int index, int count, const RandomStream& random) const override {
    const auto key = static_cast<std::uint64_t>(index) * 8;
    const auto jitter = [&](std::uint64_t k) { return 2 * random.uniform(key + k) - 1; };
    const double azimuth = 2 * kPi * (index + 0.35 * jitter(0)) / count;
    const double elevation = mix(0.12, 1.1, fract(index * 0.61803398875)) + 0.03 * jitter(1);  // spread evenly
    const double distance = 2.45 + 0.1 * jitter(2);
    const Vec3 target(0.08 * jitter(3), 0.08 * jitter(4), 0.3 + 0.06 * jitter(5));
    return looking(Vec3(0, 0, 0.3) + distance * Vec3(std::cos(elevation) * std::cos(azimuth),
                                                     std::cos(elevation) * std::sin(azimuth), std::sin(elevation)),
                   target);
  }

 private:
  Seen without_room(const Seen& seen) const {
    if (seen.solid >= 0) return seen;
    Seen nothing;
    nothing.sky = true;
    nothing.color = backdrop_;
    return nothing;
  }

  Vec3 backdrop_;
  std::unique_ptr<const World> lit_ = make_room_of(podium_with_things());
};

}  // namespace

std::unique_ptr<World> make_room() {
  std::vector<Solid> solids = podium_with_things();
  for (const double x : {-2.86, 2.86}) {
    for (const double y : {-2.46, 2.46}) {
      solids.push_back(make_solid(Shape::cylinder, Material::column, {0.2, 0, kRoomHeight}, {x, y, 0}));
    }
  }
  return make_room_of(std::move(solids));
}

std::unique_ptr<World> make_object(const Vec3& backdrop) { return std::make_unique<PodiumAlone>(backdrop); }

}  // namespace splatboost::synthetic
