// SPDX-License-Identifier: Apache-2.0
// A room around a podium; the cameras are placed around it and look inwards.
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "trainer/synth/synth_room_surfaces.h"
#include "trainer/synth/synth_world.h"

namespace splatboost::synthetic {
namespace {

using namespace room;

constexpr Vec3 kRoomLow{-3.2, -2.8, 0.0};
constexpr Vec3 kRoomHigh{3.2, 2.8, kRoomHeight};

struct Hit {
  double distance = 1e30;
  Vec3 normal{0.0};  // world, towards the ray's origin
  int solid = -1;    // -1: the room
  int wall = 0;      // of the room: 0/1 x low/high, 2/3 y, 4 floor, 5 ceiling
};

/// Whether the ray meets the solid's bounding sphere before `farthest`; a cheap test, as most rays miss most solids.
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

struct Light {
  Vec3 position;
  Vec3 power;
};

struct Shaded {
  Vec3 color{0.0};  // linear, before exposure
  Hit hit;
};

class Room final : public World {
 public:
  explicit Room(std::vector<Solid> solids) : solids_(std::move(solids)) {
    double seed = 0;
    for (Solid& solid : solids_) solid.seed = seed++;
    lights_ = {{{1.7, -1.3, 2.35}, Vec3(1.0, 0.87, 0.7) * 8.4}, {{-1.9, 1.2, 2.3}, Vec3(0.7, 0.85, 1.0) * 3.6}};
  }

  Seen probe(const Ray& ray) const override {
    const Hit hit = trace(ray);
    return {hit.distance, hit.normal, hit.solid >= 0, false, Vec3(0.0), hit.solid};
  }

  Seen look(const Ray& ray, double pixel_angle) const override {
    const Shaded shaded = shade(ray, pixel_angle);
    const Hit& hit = shaded.hit;
    return {hit.distance, hit.normal, hit.solid >= 0, false, exposed(shaded.color), hit.solid};
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

  /// Visible fraction of a small spherical lamp from a point, by a fixed pattern of rays, the same for all views.
  double light_seen(const Vec3& from, const Vec3& to) const {
    constexpr double kLampRadius = 0.07;
    constexpr std::array<Vec3, 3> kPattern{Vec3{0.9, 0.1, -0.4}, Vec3{-0.5, 0.75, 0.4}, Vec3{-0.35, -0.85, 0.0}};
    // Collect the solids near the bundle of rays: few, and for most points none.
    const Vec3 middle_way = to - from;
    const double length = glm::length(middle_way);
    const Vec3 middle = middle_way / length;
    std::array<const Solid*, kMaxSolids> near;
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

  /// Ambient light that reaches a point, 0..1: less in the corners of the room and beside solids (taken as spheres).
  double openness(const Hit& hit, const Vec3& p) const {
    double open = 1;
    for (int axis = 0; axis < 3; ++axis) {
      for (const double distance : {p[axis] - kRoomLow[axis], kRoomHigh[axis] - p[axis]}) {
        if (hit.solid < 0 && hit.wall / 2 == axis) continue;  // skip the point's own wall
        open *= 1 - 0.42 / (1 + distance * distance * 40);
      }
    }
    for (std::size_t i = 1; i < solids_.size(); ++i) {  // skip the podium: too flat to count as a sphere
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

  static constexpr std::size_t kMaxSolids = 32;
  std::vector<Solid> solids_;  // at most kMaxSolids
  std::vector<Light> lights_;
};

}  // namespace

std::unique_ptr<World> room::make_room_of(std::vector<Solid> solids) {
  return std::make_unique<Room>(std::move(solids));
}

}  // namespace splatboost::synthetic
