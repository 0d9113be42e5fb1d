// SPDX-License-Identifier: Apache-2.0
#include "trainer/points/initial_points.h"

#include <algorithm>
#include <string>

#include <glm/geometric.hpp>
#include <glm/matrix.hpp>
#include <glm/vec4.hpp>

#include "splatboost/constants.h"
#include "splatboost/random.h"
#include "trainer/features/nearest_to_lines.h"
#include "trainer/support/input_error.h"

namespace splatboost {

PointBox synthetic_box() { return {glm::dvec3(0.0), 1.3f}; }

PointBox look_at_box(const std::vector<View>& views) {
  const auto forward = [](const View& view) { return glm::dvec3(glm::transpose(view.camera.rotation())[2]); };
  glm::dvec3 mean_centre(0.0), mean_forward(0.0);
  for (const View& view : views) {
    mean_centre += glm::dvec3(view.camera.centre());
    mean_forward += forward(view);
  }
  mean_centre /= static_cast<double>(views.size());

  NearestToLines axes;
  for (const View& view : views) axes.add(glm::dvec3(view.camera.centre()), forward(view));
  double spread_of_cameras = 0;
  for (const View& view : views) {
    spread_of_cameras = std::max(spread_of_cameras, glm::length(glm::dvec3(view.camera.centre()) - mean_centre));
  }
  PointBox box;
  if (axes.condition() > 1e-3) {
    box.centre = axes.point();
  } else {
    const double length = glm::length(mean_forward);
    const glm::dvec3 direction = length > 1e-9 ? mean_forward / length : forward(views.front());
    box.centre = mean_centre + direction * (spread_of_cameras > 0 ? 3 * spread_of_cameras : 1.0);
  }
  for (const View& view : views) {
    box.half = std::max(box.half, glm::length(glm::dvec3(view.camera.centre()) - box.centre));
  }
  if (!(box.half > 0)) box.half = 1;
  return box;
}

void require_visible_points(const Scene& scene) {
  for (const View& view : scene.train) {
    const Camera& camera = view.camera;
    for (std::size_t i = 0; i < scene.points.size(); ++i) {
      const float* const at = &scene.points.positions[3 * i];
      const glm::vec3 p(camera.camera_from_world * glm::vec4(at[0], at[1], at[2], 1));
      if (!(p.z > kNearPlane)) continue;
      const float x = camera.fx * p.x / p.z + camera.cx, y = camera.fy * p.y / p.z + camera.cy;
      if (x >= 0 && y >= 0 && x < static_cast<float>(camera.width) && y < static_cast<float>(camera.height)) return;
    }
  }
  throw InputError("none of the " + std::to_string(scene.points.size()) +
                   " initial points lies in a training view, beyond its near plane at 0.2 units: do the points and the "
                   "camera poses have the same frame, and a scale at which the scene is farther away?");
}

PointCloud random_points(const PointBox& box, int count, std::uint64_t seed) {
  const RandomStream random(seed, 0, RandomPurpose::init_points);
  const auto n = static_cast<std::size_t>(count);
  PointCloud points;
  points.positions.resize(3 * n);
  points.colors.assign(3 * n, 128);
  for (std::size_t i = 0; i < 3 * n; ++i) {
    const double middle = box.centre[static_cast<int>(i % 3)];
    points.positions[i] = static_cast<float>(middle + box.half * (2 * random.uniform(i) - 1));
  }
  return points;
}

}  // namespace splatboost
