// SPDX-License-Identifier: Apache-2.0
// A straight street of houses, 64 m long, under a sky dome. Some cameras walk along it, some are close to a facade,
// some fly above: one scene with scales from centimetres to tens of metres.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "trainer/synth/synth_street_surfaces.h"
#include "trainer/synth/synth_world.h"

namespace splatboost::synthetic {
namespace {

using namespace street;

constexpr double kSkyRadius = 75;
constexpr int kHouses = 7;  // per side
const Vec3 kSun = glm::normalize(Vec3(0.5, -0.42, 0.76));

struct Hit {
  double distance = 1e30;
  Vec3 normal{0.0};
  int solid = -1;  // -1: ground, -2: sky
};

/// A roof with its ridge along x.
LocalHit hit_gable(const Ray& ray, const Vec3& size) {
  const Vec3 slope = glm::normalize(Vec3(0, size.z, size.y));
  struct Plane {
    Vec3 normal;
    double at;
  };
  const std::array<Plane, 5> planes{{{{1, 0, 0}, size.x},
                                     {{-1, 0, 0}, size.x},
                                     {{0, 0, -1}, 0},
                                     {slope, slope.y * size.y},
                                     {{0, -slope.y, slope.z}, slope.y * size.y}}};
  LocalHit hit;
  double enter = -1e30, leave = 1e30;
  Vec3 normal(0.0);
  for (const Plane& plane : planes) {
    const double along = glm::dot(plane.normal, ray.direction);
    const double gap = plane.at - glm::dot(plane.normal, ray.origin);
    if (std::abs(along) < 1e-12) {
      if (gap < 0) return hit;
      continue;
    }
    const double distance = gap / along;
    if (along < 0 && distance > enter) {
      enter = distance;
      normal = plane.normal;
    } else if (along > 0) {
      leave = std::min(leave, distance);
    }
  }
  if (enter < leave) keep_nearest(hit, enter, normal);
  return hit;
}

LocalHit hit_solid(const Solid& solid, const Ray& ray) {
  const Ray local{solid.local_from_world * (ray.origin - solid.position), solid.local_from_world * ray.direction};
  switch (solid.shape) {
    case Shape::box:
      return hit_box(local, solid.size);
    case Shape::gable:
      return hit_gable(local, solid.size);
    case Shape::sphere:
      return hit_sphere(local, solid.size.x);
    case Shape::cylinder:
      return hit_round(local, solid.size.x, solid.size.z, 0);
  }
  return {};
}

bool comes_near(const Solid& solid, const Ray& ray, double farthest) {
  const Vec3 to_centre = solid.bound_centre - ray.origin;
  const double along = glm::dot(to_centre, ray.direction), radius = solid.bound_radius;
  return glm::dot(to_centre, to_centre) - along * along <= radius * radius && along >= -radius &&
         along - radius <= farthest;
}

class Street final : public World {
 public:
  Street() {
    for (const double side : {-1.0, 1.0}) {
      for (int i = 0; i < kHouses; ++i) add_lot(side, kLot * (i - kHouses / 2), 20.0 + i + (side > 0 ? kHouses : 0));
      for (int i = 0; i <= kHouses; ++i) add_tree(side, kLot * (i - 0.5 - kHouses / 2), 60.0 + i + (side > 0 ? 10 : 0));
      for (int i = 0; i < 4; ++i) add_lamp({-25.0 + 16.5 * i + 3 * side, side * 3.95, 0});
    }
    add_car({-19.5, -2.55, 0}, 0, 3);
    add_car({-7.4, 2.55, 0}, 180, 4);
    add_car({6.2, -2.55, 0}, 0, 8);
    add_car({13.4, 2.6, 0}, 180, 5);
    add_car({23.0, -2.5, 0}, 0, 6);
    add_car({-25.5, 2.5, 0}, 180, 7);
  }

  Seen probe(const Ray& ray) const override {
    const Hit hit = trace(ray);
    return {hit.distance, hit.normal, hit.solid >= 0, hit.solid == -2, Vec3(0.0)};
  }

  Seen look(const Ray& ray, double pixel_angle) const override {
    const Hit hit = trace(ray);
    Seen seen{hit.distance, hit.normal, hit.solid >= 0, hit.solid == -2, Vec3(0.0)};
    const Vec3 p = ray.origin + hit.distance * ray.direction;
    if (seen.sky) {
      seen.color = sky_color(glm::normalize(p));
      return seen;
    }
    const Vec3 view = -ray.direction;
    const double facing = std::max(0.2, std::abs(glm::dot(hit.normal, view)));
    const double width = hit.distance * pixel_angle / facing;
    const Surface surface = surface_at(hit, p, width);
    const Vec3 sky = mix(srgb(128, 118, 104), srgb(176, 202, 232), 0.5 + 0.5 * hit.normal.z);
    Vec3 color = surface.albedo * sky * (0.85 * openness(hit, p));
    const double cosine = glm::dot(hit.normal, kSun);
    if (cosine > 0) {
      const double lit = sun_seen(p + 2e-4 * hit.normal);
      const double gleam =
          std::pow(std::max(0.0, glm::dot(hit.normal, glm::normalize(kSun + view))), surface.shininess);
      color += lit * Vec3(1.45, 1.32, 1.1) * (surface.albedo * cosine + surface.specular * gleam);
    }
    for (int c = 0; c < 3; ++c) seen.color[c] = 1 - std::exp(-1.2 * color[c]);
    return seen;
  }

  Pose camera(int index, int /*count*/, const RandomStream& random) const override {
    const auto key = static_cast<std::uint64_t>(index) * 8;
    const auto jitter = [&](std::uint64_t k) { return 2 * random.uniform(key + k) - 1; };
    const double along = 54 * (fract(index * 0.61803398875) - 0.5);  // spread evenly, neighbours far apart
    switch (index % 5) {
      case 3: {  // close to a facade
        const double side = jitter(0) > 0 ? 1.0 : -1.0;
        const double house = kLot * std::floor(along / kLot + 0.5);
        const Vec3 centre{house + 1.6 * jitter(1), side * (6.1 + 0.45 * jitter(2)), 1.35 + 0.35 * jitter(3)};
        return looking(centre, {house + 1.8 * jitter(4), side * kFronts, 1.5 + 0.8 * jitter(5)});
      }
      case 4: {  // above
        const Vec3 centre{along, 3.5 * jitter(0), 14 + 5 * jitter(1)};
        const double ahead = (centre.x > 0 ? -1.0 : 1.0) * (13 + 7 * jitter(2));
        return looking(centre, {centre.x + ahead, 6 * jitter(3), 1});
      }
      default: {  // on foot
        // Near the ends of the street, never look out of it.
        const bool back = std::abs(along) > 12 ? along > 0 : jitter(0) > 0;
        const double yaw = (back ? kPi : 0.0) + 1.15 * jitter(1);
        const Vec3 centre{along, 0.9 * jitter(2), 1.6 + 0.25 * jitter(3)};
        return looking(centre, centre + Vec3(std::cos(yaw), std::sin(yaw), 0.06 + 0.12 * jitter(4)));
      }
    }
  }

 private:
  void add(Shape shape, Material material, const Vec3& size, const Vec3& position, double seed,
           const Mat3& local_from_world = Mat3(1.0)) {
    Solid solid{shape, material, size, position, local_from_world, seed};
    Vec3 middle(0.0);
    solid.bound_radius = glm::length(size);
    if (shape == Shape::sphere) solid.bound_radius = size.x;
    if (shape == Shape::cylinder) {
      middle = {0, 0, 0.5 * size.z};
      solid.bound_radius = std::hypot(size.x, 0.5 * size.z);
    }
    solid.bound_centre = position + glm::transpose(local_from_world) * middle;
    solids_.push_back(solid);
  }

  void add_lot(double side, double x, double seed) {
    const double half = 2.9 + 0.6 * seeded(seed, 20), depth = 3.2, height = seeded(seed, 21) > 0.5 ? 6.0 : 3.7;
    const double y = side * (kFronts + depth);
    add(Shape::box, Material::house, {half, depth, 0.5 * height}, {x, y, 0.5 * height}, seed);
    add(Shape::gable, Material::roof, {half + 0.35, depth + 0.45, 2.0 + 1.2 * seeded(seed, 22)}, {x, y, height}, seed);
    const double chimney = x + 0.5 * half;
    add(Shape::box, Material::house, {0.28, 0.28, 1.0}, {chimney, y + side * 0.6, height + 2.2}, seed + 0.5);
    for (const double edge_of_path : {-1.0, 1.0}) {
      const double fence_half = 0.5 * (0.5 * kLot - 0.8);
      add(Shape::box, Material::fence, {fence_half, 0.03, 0.36},
          {x + edge_of_path * (0.8 + fence_half), side * 6.95, 0.36}, seed);
      add(Shape::cylinder, Material::pot, {0.17, 0, 0.34}, {x + edge_of_path * 0.95, side * (kFronts - 0.3), 0}, seed);
      add(Shape::sphere, Material::leaves, Vec3(0.27), {x + edge_of_path * 0.95, side * (kFronts - 0.3), 0.52},
          seed + 3 * edge_of_path);
    }
    add(Shape::cylinder, Material::metal, {0.035, 0, 1.0}, {x + 1.0, side * 6.9, 0}, seed);
    add(Shape::box, Material::letterbox, {0.17, 0.11, 0.14}, {x + 1.0, side * 6.9, 1.1}, seed);
    if (seeded(seed, 23) > 0.4) {
      add(Shape::box, Material::bench, {0.75, 0.2, 0.03}, {x - 2.0, side * (kFronts - 0.5), 0.45}, seed);
      add(Shape::box, Material::bench, {0.75, 0.03, 0.2}, {x - 2.0, side * (kFronts - 0.28), 0.75}, seed);
      for (const double leg : {-0.6, 0.6}) {
        add(Shape::box, Material::metal, {0.03, 0.18, 0.22}, {x - 2.0 + leg, side * (kFronts - 0.5), 0.21}, seed);
      }
    }
  }

  void add_tree(double side, double x, double seed) {
    const double height = 2.1 + 0.8 * seeded(seed, 30);
    const Vec3 foot{x, side * 5.2, 0};
    add(Shape::cylinder, Material::bark, {0.15, 0, height}, foot, seed);
    for (int i = 0; i < 4; ++i) {
      const double turn = 1.6 * i + 6 * seeded(seed, 31);
      const Vec3 at = foot + Vec3(0.55 * std::cos(turn), 0.55 * std::sin(turn), height + 0.2 + 0.35 * i);
      add(Shape::sphere, Material::leaves, Vec3(0.75 + 0.25 * seeded(seed, 32 + i)), at, seed + i);
    }
  }

  void add_lamp(const Vec3& foot) {
    add(Shape::cylinder, Material::metal, {0.055, 0, 3.6}, foot, 1);
    add(Shape::sphere, Material::lamp, Vec3(0.19), foot + Vec3(0, 0, 3.75), 1);
  }

  void add_car(const Vec3& at, double degrees, double seed) {
    const double turn = degrees * kPi / 180, c = std::cos(turn), s = std::sin(turn);
    const Mat3 local_from_world = glm::transpose(Mat3(Vec3(c, s, 0), Vec3(-s, c, 0), Vec3(0, 0, 1)));
    const auto place = [&](const Vec3& p) { return at + glm::transpose(local_from_world) * p; };
    add(Shape::box, Material::car, {1.95, 0.84, 0.31}, place({0, 0, 0.6}), seed, local_from_world);
    add(Shape::box, Material::car, {1.05, 0.74, 0.28}, place({-0.15, 0, 1.18}), seed, local_from_world);
    const Mat3 lying = Mat3(Vec3(1, 0, 0), Vec3(0, 0, 1), Vec3(0, -1, 0)) * local_from_world;
    for (const double x : {-1.2, 1.2}) {
      for (const double y : {-0.86, 0.66})
        add(Shape::cylinder, Material::tyre, {0.32, 0, 0.2}, place({x, y, 0.32}), seed, lying);
    }
  }

  Hit trace(const Ray& ray) const {
    Hit hit;
    const double b = glm::dot(ray.origin, ray.direction);
    hit.distance = -b + std::sqrt(b * b - glm::dot(ray.origin, ray.origin) + kSkyRadius * kSkyRadius);
    hit.solid = -2;
    if (ray.direction.z < 0 && -ray.origin.z / ray.direction.z < hit.distance) {
      hit = {-ray.origin.z / ray.direction.z, {0, 0, 1}, -1};
    }
    for (std::size_t i = 0; i < solids_.size(); ++i) {
      if (!comes_near(solids_[i], ray, hit.distance)) continue;
      const LocalHit local = hit_solid(solids_[i], ray);
      if (local.distance < hit.distance) {
        hit = {local.distance, glm::transpose(solids_[i].local_from_world) * local.normal, static_cast<int>(i)};
      }
    }
    return hit;
  }

  Surface surface_at(const Hit& hit, const Vec3& p, double width) const {
    if (hit.solid < 0) return ground(p, width);
    const Solid& solid = solids_[static_cast<std::size_t>(hit.solid)];
    return surface_of(solid, solid.local_from_world * (p - solid.position), solid.local_from_world * hit.normal, width);
  }

  double sun_seen(const Vec3& from) const {
    const Ray ray{from, kSun};
    for (const Solid& solid : solids_) {
      if (comes_near(solid, ray, 1e9) && hit_solid(solid, ray).distance < 1e9) return 0;
    }
    return 1;
  }

  /// Ambient light that reaches a point, 0..1: less near the ground, and on the ground less beside and under boxes.
  double openness(const Hit& hit, const Vec3& p) const {
    if (hit.solid >= 0) return 1 - 0.4 * std::exp(-3 * p.z) - (hit.normal.z < -0.5 ? 0.4 : 0.0);
    double open = 1;
    for (const Solid& solid : solids_) {
      if (solid.shape != Shape::box || solid.size.x < 0.5 || solid.position.z > 3.1) continue;
      const double dx = std::max(0.0, std::abs(p.x - solid.position.x) - solid.size.x);
      const double dy = std::max(0.0, std::abs(p.y - solid.position.y) - solid.size.y);
      const double gap = std::hypot(dx, dy);
      if (gap < 1.5) open *= 1 - 0.5 * std::exp(-3 * gap);
    }
    return open;
  }

  std::vector<Solid> solids_;
};

}  // namespace

std::unique_ptr<World> make_street() { return std::make_unique<Street>(); }

}  // namespace splatboost::synthetic
