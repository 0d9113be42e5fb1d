// SPDX-License-Identifier: Apache-2.0
#include "pgsr/neighbor_views.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>

#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>

namespace splatboost {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

}  // namespace

std::vector<std::vector<std::size_t>> neighbor_views(const std::vector<View>& views, const NeighborLimits& limits) {
  std::vector<glm::dvec3> centres, directions;
  for (const View& view : views) {
    centres.emplace_back(view.camera.centre());
    const glm::mat3 rotation = view.camera.rotation();
    directions.emplace_back(glm::normalize(glm::dvec3(rotation[0][2], rotation[1][2], rotation[2][2])));
  }
  std::vector<std::vector<std::size_t>> neighbors(views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    std::vector<std::tuple<double, double, std::size_t>> found;
    for (std::size_t j = 0; j < views.size(); ++j) {
      if (j == i) continue;
      const double distance = glm::length(centres[j] - centres[i]);
      const double angle = std::acos(std::clamp(glm::dot(directions[i], directions[j]), -1.0, 1.0)) / kDegree;
      if (angle < limits.angle && distance > limits.nearest && distance < limits.farthest) {
        found.emplace_back(distance, angle, j);
      }
    }
    std::sort(found.begin(), found.end());
    if (found.size() > static_cast<std::size_t>(limits.most)) found.resize(static_cast<std::size_t>(limits.most));
    for (const auto& each : found) neighbors[i].push_back(std::get<2>(each));
  }
  return neighbors;
}

View virtual_view(const View& near, double shift, double turn, const RandomStream& random) {
  const auto between = [&](std::uint64_t number, double most) { return most * (2 * random.uniform(number) - 1); };
  View view;
  view.name = "virtual";
  view.camera = near.camera;
  view.time = near.time;
  glm::dmat4 moved(1.0);
  moved = glm::translate(moved, glm::dvec3(between(0, shift), between(1, shift), between(2, shift)));
  moved = glm::rotate(moved, between(3, turn) * kDegree, glm::dvec3(1, 0, 0));
  moved = glm::rotate(moved, between(4, turn) * kDegree, glm::dvec3(0, 1, 0));
  moved = glm::rotate(moved, between(5, turn) * kDegree, glm::dvec3(0, 0, 1));
  view.camera.camera_from_world = glm::mat4(moved * glm::dmat4(near.camera.camera_from_world));
  return view;
}

}  // namespace splatboost
