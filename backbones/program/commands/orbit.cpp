// SPDX-License-Identifier: Apache-2.0
#include "program/commands/orbit.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>
#include <glm/vec3.hpp>

namespace splatboost::program {
namespace {

constexpr double kTwoPi = 6.283185307179586;

// If the largest gap between cameras is wider than this, a full circle would show parts that no photo shows.
constexpr double kLargestGap = kTwoPi / 4;

// Weight of the median of the point cloud against a camera's axis in the search for the centre of interest. It matters
// only if the axes are nearly parallel and do not determine a point.
constexpr double kCloudWeight = 0.02;

glm::dvec3 axis(const Camera& camera, int row) {
  const glm::mat3 r = camera.rotation();
  return {r[0][row], r[1][row], r[2][row]};
}

glm::dvec3 middle_of(const PointCloud& cloud) {
  glm::dvec3 middle(0);
  std::vector<float> values(cloud.size());
  for (int axis_index = 0; axis_index < 3; ++axis_index) {
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] = cloud.positions[3 * i + static_cast<std::size_t>(axis_index)];
    const auto half = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), half, values.end());
    middle[axis_index] = *half;
  }
  return middle;
}

/// The point nearest to the cameras' view axes, by least squares.
glm::dvec3 middle_of_interest(const Scene& scene) {
  glm::dmat3 a(0);
  glm::dvec3 b(0);
  for (const View& view : scene.train) {
    const glm::dvec3 forward = axis(view.camera, 2);
    const glm::dmat3 across = glm::dmat3(1) - glm::outerProduct(forward, forward);
    a += across;
    b += across * glm::dvec3(view.camera.centre());
  }
  glm::dvec3 middle(0);
  if (scene.points.size() > 0) {
    middle = middle_of(scene.points);
  } else {
    for (const View& view : scene.train) middle += glm::dvec3(view.camera.centre()) + axis(view.camera, 2);
    middle /= static_cast<double>(scene.train.size());
  }
  const double weight = kCloudWeight * static_cast<double>(scene.train.size());
  return glm::inverse(a + glm::dmat3(weight)) * (b + weight * middle);
}

/// Direction away from the ground. Photographers keep the horizon level, so it is perpendicular to the right axes of
/// all cameras, even if most of them look down from one side. If the right axes agree, the up axes of the cameras
/// decide.
glm::dvec3 up_of(const std::vector<View>& views) {
  constexpr int kSteps = 200;
  glm::dvec3 up(0);
  glm::dmat3 right_axes(0);
  for (const View& view : views) {
    up -= axis(view.camera, 1);
    right_axes += glm::outerProduct(axis(view.camera, 0), axis(view.camera, 0));
  }
  if (glm::length(up) < 1e-6) return -axis(views[0].camera, 1);
  // Power iteration towards the smallest eigenvalue, from the mean up.
  const glm::dmat3 towards = glm::dmat3(1) - right_axes / static_cast<double>(views.size());
  for (int step = 0; step < kSteps; ++step) {
    up = glm::normalize(up);
    const glm::dvec3 next = towards * up;
    if (glm::length(next) < 1e-6) break;
    up = next;
  }
  return glm::normalize(up);
}

Camera looking_at(const Camera& optics, const glm::dvec3& eye, const glm::dvec3& target, const glm::dvec3& up) {
  const glm::dvec3 z = glm::normalize(target - eye);
  const glm::dvec3 x = glm::normalize(glm::cross(z, up));
  const glm::dvec3 y = glm::cross(z, x);
  Camera camera = optics;
  camera.cx = static_cast<float>(camera.width) / 2;
  camera.cy = static_cast<float>(camera.height) / 2;
  const glm::dmat3 rotation = glm::transpose(glm::dmat3(x, y, z));
  glm::dmat4 pose(rotation);
  pose[3] = glm::dvec4(-(rotation * eye), 1);
  camera.camera_from_world = glm::mat4(pose);
  return camera;
}

}  // namespace

std::vector<Camera> orbit_cameras(const Scene& scene, int count) {
  const glm::dvec3 middle = middle_of_interest(scene);
  const glm::dvec3 up = up_of(scene.train);

  // An orthonormal frame around `up`, from a world axis that is far from parallel to it.
  const glm::dvec3 helper = std::abs(up.x) < 0.7 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
  const glm::dvec3 e1 = glm::normalize(glm::cross(up, helper));
  const glm::dvec3 e2 = glm::cross(up, e1);

  double radius = 0;
  double height = 0;
  double outward = 0;
  std::vector<double> angles;
  for (const View& view : scene.train) {
    const glm::dvec3 from_middle = glm::dvec3(view.camera.centre()) - middle;
    height += glm::dot(from_middle, up);
    radius += std::hypot(glm::dot(from_middle, e1), glm::dot(from_middle, e2));
    outward += glm::dot(from_middle, axis(view.camera, 2)) > 0 ? 1 : -1;
    angles.push_back(std::atan2(glm::dot(from_middle, e2), glm::dot(from_middle, e1)));
  }
  const double n = static_cast<double>(scene.train.size());
  height /= n;
  radius = std::max(radius / n, 1e-3 * std::max(1.0, static_cast<double>(scene.extent)));

  // The cameras' arc is the circle without its largest gap.
  std::sort(angles.begin(), angles.end());
  double gap = angles.front() + kTwoPi - angles.back();
  double arc_begin = angles.front();
  for (std::size_t i = 1; i < angles.size(); ++i) {
    if (angles[i] - angles[i - 1] > gap) {
      gap = angles[i] - angles[i - 1];
      arc_begin = angles[i];
    }
  }
  const bool turns = gap <= kLargestGap;
  const double half_arc = (kTwoPi - gap) / 2;

  std::vector<Camera> cameras;
  for (int i = 0; i < count; ++i) {
    const double phase = kTwoPi * i / count;
    const double angle = turns ? arc_begin + phase : arc_begin + half_arc + half_arc * std::sin(phase);
    const glm::dvec3 eye = middle + height * up + radius * (std::cos(angle) * e1 + std::sin(angle) * e2);
    // Cameras that look outwards do not see the centre, so the orbit looks outwards too.
    const glm::dvec3 target = outward > 0 ? eye + (eye - middle) : middle;
    cameras.push_back(looking_at(scene.train[0].camera, eye, target, up));
  }
  return cameras;
}

}  // namespace splatboost::program
