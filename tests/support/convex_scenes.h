// SPDX-License-Identifier: Apache-2.0
/// @file Random convexes for tests, and their conversion for the double-precision reference.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "reference/convexes.h"
#include "splatboost/convex_rasterizer.h"
#include "support/scenes.h"

namespace splatboost::test {

/// Parameters of a random scene of convexes.
struct ConvexSceneSpec {
  std::size_t count = 12;
  int points_per_convex = 6;
  int sh_degree = 3;    ///< ignored with colors
  bool colors = false;  ///< colours instead of spherical harmonics
  double smallest = 3;  ///< distance of the points from the centre on screen, pixels
  double largest = 16;
  double opacity_low = 0.05;
  double opacity_high = 0.98;
  double soft = 0.4;  ///< approximate range of z·σ·φ half way to the edge: soft … steep
  double steep = 8;
  double behind = 0.1;  ///< fraction of convexes behind the camera
};

/// Owns a scene's arrays.
struct ConvexSceneData {
  std::size_t count = 0;
  int points_per_convex = 6;
  std::vector<float> points, smoothness, sharpness, opacities, sh_dc, sh_rest, colors;
  int sh_rest_rows = 0;
  int sh_degree = 0;

  Convexes view() const {
    Convexes c;
    c.count = count;
    c.points_per_convex = points_per_convex;
    c.points = points;
    c.smoothness = smoothness;
    c.sharpness = sharpness;
    c.opacities = opacities;
    c.sh_dc = sh_dc;
    c.sh_rest = sh_rest;
    c.sh_rest_rows = sh_rest_rows;
    c.sh_degree = sh_degree;
    c.colors = colors;
    return c;
  }

  reference::ConvexScene<double> reference() const {
    const auto copy = [](const std::vector<float>& from) { return std::vector<double>(from.begin(), from.end()); };
    reference::ConvexScene<double> scene;
    scene.count = count;
    scene.points_per_convex = static_cast<std::size_t>(points_per_convex);
    scene.points = copy(points);
    scene.smoothness = copy(smoothness);
    scene.sharpness = copy(sharpness);
    scene.opacities = copy(opacities);
    scene.sh_dc = copy(sh_dc);
    scene.sh_rest = copy(sh_rest);
    scene.sh_rest_rows = sh_rest_rows;
    scene.sh_degree = sh_degree;
    scene.colors = copy(colors);
    return scene;
  }
};

inline ConvexSceneData random_convexes(const Camera& camera, const ConvexSceneSpec& spec, std::uint64_t seed) {
  Numbers random(seed);
  ConvexSceneData scene;
  scene.count = spec.count;
  scene.points_per_convex = spec.points_per_convex;
  if (!spec.colors) {
    scene.sh_degree = spec.sh_degree;
    scene.sh_rest_rows = (spec.sh_degree + 1) * (spec.sh_degree + 1) - 1;
  }
  const glm::mat3 world_from_camera = glm::transpose(camera.rotation());
  const glm::vec3 eye = camera.centre();
  for (std::size_t i = 0; i < spec.count; ++i) {
    const double z = random.uniform(1.5, 6);
    const double sign = random.uniform(0, 1) < spec.behind ? -1 : 1;
    const double u = random.uniform(-0.1, 1.1) * camera.width, v = random.uniform(-0.1, 1.1) * camera.height;
    const double radius = random.magnitude(spec.smallest, spec.largest);  // px
    for (int p = 0; p < spec.points_per_convex; ++p) {
      const double depth = z + random.uniform(-0.2, 0.2);
      const double x = u + radius * random.uniform(-1, 1), y = v + radius * random.uniform(-1, 1);
      const glm::vec3 in_camera(
          static_cast<float>((x - static_cast<double>(camera.cx)) * depth / static_cast<double>(camera.fx)),
          static_cast<float>((y - static_cast<double>(camera.cy)) * depth / static_cast<double>(camera.fy)),
          static_cast<float>(sign * depth));
      const glm::vec3 world = world_from_camera * in_camera + eye;
      for (int c = 0; c < 3; ++c) scene.points.push_back(world[c]);
    }
    // Half way to an edge of length r the term is about z·δ·r²/2.
    const double term = random.magnitude(0.5, 20);
    scene.smoothness.push_back(static_cast<float>(term / (z * 0.5 * radius * radius)));
    scene.sharpness.push_back(static_cast<float>(random.magnitude(spec.soft, spec.steep) / (z * term)));
    scene.opacities.push_back(random.real(spec.opacity_low, spec.opacity_high));
    if (spec.colors) {
      for (int c = 0; c < 3; ++c) scene.colors.push_back(random.real(-0.2, 1.2));
    } else {
      for (int c = 0; c < 3; ++c) scene.sh_dc.push_back(random.real(-1.5, 2.5));
      for (int k = 0; k < 3 * scene.sh_rest_rows; ++k) scene.sh_rest.push_back(random.real(-0.3, 0.3));
    }
  }
  return scene;
}

inline reference::ConvexOptions reference_options(const ConvexOptions& options) {
  reference::ConvexOptions result;
  result.compact = options.box == ConvexBox::compact;
  result.beta = static_cast<double>(options.beta);
  result.near_plane = static_cast<double>(options.near_plane);
  result.pixel_size = static_cast<double>(options.pixel_size);
  result.released_view_direction = options.released_view_direction;
  for (int c = 0; c < 3; ++c)
    result.background[static_cast<std::size_t>(c)] = static_cast<double>(options.background[c]);
  return result;
}

/// Owns an array for every gradient of the scene.
struct ConvexGradientData {
  std::vector<float> points, smoothness, sharpness, opacities, sh_dc, sh_rest, colors, view_sharpness,
      view_sharpness_abs, screen_points;

  explicit ConvexGradientData(const ConvexSceneData& scene, float value = std::nanf(""))
      : points(scene.points.size(), value),
        smoothness(scene.count, value),
        sharpness(scene.count, value),
        opacities(scene.count, value),
        sh_dc(scene.sh_dc.size(), value),
        sh_rest(scene.sh_rest.size(), value),
        colors(scene.colors.size(), value),
        view_sharpness(scene.count, value),
        view_sharpness_abs(scene.count, value),
        screen_points(3 * scene.count, value) {}

  ConvexGradients view(GradientMode mode = GradientMode::overwrite) {
    return {mode,    points, smoothness,     sharpness,          opacities,    sh_dc,
            sh_rest, colors, view_sharpness, view_sharpness_abs, screen_points};
  }
  /// All gradient arrays.
  std::vector<const std::vector<float>*> all() const {
    return {&points,  &smoothness, &sharpness,      &opacities,          &sh_dc,
            &sh_rest, &colors,     &view_sharpness, &view_sharpness_abs, &screen_points};
  }
};

}  // namespace splatboost::test
