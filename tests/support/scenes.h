// SPDX-License-Identifier: Apache-2.0
/// @file Cameras and random Gaussians for tests, and their conversion for the double-precision reference.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include <glm/gtc/quaternion.hpp>
#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>

#include "reference/rasterizer.h"
#include "splatboost/camera.h"
#include "splatboost/gaussians.h"
#include "splatboost/rasterizer.h"

namespace splatboost::test {

/// Uniform random numbers that are the same with every standard library.
class Numbers {
 public:
  explicit Numbers(std::uint64_t seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return low + (high - low) * (static_cast<double>(engine_() >> 11) * 0x1.0p-53);
  }
  float real(double low, double high) { return static_cast<float>(uniform(low, high)); }
  /// Log-uniform.
  double magnitude(double low, double high) { return std::exp(uniform(std::log(low), std::log(high))); }
  std::uint64_t bits() { return engine_(); }

 private:
  std::mt19937_64 engine_;
};

inline std::vector<float> numbers(std::size_t n, double low, double high, std::uint64_t seed) {
  Numbers random(seed);
  std::vector<float> values;
  for (std::size_t i = 0; i < n; ++i) values.push_back(random.real(low, high));
  return values;
}

/// A camera with an oblique pose and an off-centre principal point.
inline Camera oblique_camera(int width, int height) {
  Camera camera;
  camera.width = width;
  camera.height = height;
  const float size = static_cast<float>(std::max(width, height));
  camera.fx = 0.9f * size;
  camera.fy = 1.1f * size;
  camera.cx = 0.55f * static_cast<float>(width);
  camera.cy = 0.42f * static_cast<float>(height);
  const glm::quat turn = glm::normalize(glm::quat(0.9f, 0.2f, -0.35f, 0.15f));
  camera.camera_from_world = glm::mat4(glm::mat3_cast(turn));
  camera.camera_from_world[3] = glm::vec4(0.3f, -0.4f, 1.2f, 1.0f);
  return camera;
}

/// Parameters of a random scene.
struct SceneSpec {
  std::size_t count = 24;
  int sh_degree = 3;         ///< ignored with colors
  int sh_rest_rows = -1;     ///< −1: as many as the degree needs
  bool colors = false;       ///< colours instead of spherical harmonics
  bool covariances = false;  ///< covariances instead of scales and rotations
  int features = 0;
  double smallest = 0.6;  ///< standard deviations on screen, pixels
  double largest = 7;
  double opacity_low = 0.05;
  double opacity_high = 0.95;
  double nearest = 1;  ///< depths
  double farthest = 6;
  double margin = 0.15;  ///< means lie in the image widened by this fraction on each side
  double behind = 0.1;   ///< fraction of means behind the camera
};

/// Owns a scene's arrays.
struct SceneData {
  std::size_t count = 0;
  std::vector<float> means, scales, rotations, covariances, opacities, sh_dc, sh_rest, colors, features;
  int sh_rest_rows = 0;
  int sh_degree = 0;
  int features_per_gaussian = 0;

  Gaussians view() const {
    Gaussians g;
    g.count = count;
    g.means = means;
    g.scales = scales;
    g.rotations = rotations;
    g.covariances = covariances;
    g.opacities = opacities;
    g.sh_dc = sh_dc;
    g.sh_rest = sh_rest;
    g.sh_rest_rows = sh_rest_rows;
    g.sh_degree = sh_degree;
    g.colors = colors;
    g.features = features;
    g.features_per_gaussian = features_per_gaussian;
    return g;
  }

  reference::Scene<double> reference() const {
    const auto copy = [](const std::vector<float>& from) { return std::vector<double>(from.begin(), from.end()); };
    reference::Scene<double> scene;
    scene.count = count;
    scene.means = copy(means);
    scene.scales = copy(scales);
    scene.rotations = copy(rotations);
    scene.covariances = copy(covariances);
    scene.opacities = copy(opacities);
    scene.sh_dc = copy(sh_dc);
    scene.sh_rest = copy(sh_rest);
    scene.sh_rest_rows = sh_rest_rows;
    scene.sh_degree = sh_degree;
    scene.colors = copy(colors);
    scene.features = copy(features);
    scene.features_per_gaussian = features_per_gaussian;
    return scene;
  }
};

inline SceneData random_scene(const Camera& camera, const SceneSpec& spec, std::uint64_t seed) {
  Numbers random(seed);
  SceneData scene;
  scene.count = spec.count;
  scene.features_per_gaussian = spec.features;
  if (!spec.colors) {
    scene.sh_degree = spec.sh_degree;
    scene.sh_rest_rows = spec.sh_rest_rows >= 0 ? spec.sh_rest_rows : (spec.sh_degree + 1) * (spec.sh_degree + 1) - 1;
  }
  const glm::mat3 world_from_camera = glm::transpose(camera.rotation());
  const glm::vec3 centre = -(world_from_camera * glm::vec3(camera.camera_from_world[3]));
  for (std::size_t i = 0; i < spec.count; ++i) {
    const double z = random.uniform(spec.nearest, spec.farthest);
    const double u = random.uniform(-spec.margin, 1 + spec.margin) * camera.width;
    const double v = random.uniform(-spec.margin, 1 + spec.margin) * camera.height;
    const double sign = random.uniform(0, 1) < spec.behind ? -1 : 1;
    const glm::vec3 in_camera(
        static_cast<float>((u - static_cast<double>(camera.cx)) * z / static_cast<double>(camera.fx)),
        static_cast<float>((v - static_cast<double>(camera.cy)) * z / static_cast<double>(camera.fy)),
        static_cast<float>(sign * z));
    const glm::vec3 mean = world_from_camera * in_camera + centre;
    for (int axis = 0; axis < 3; ++axis) scene.means.push_back(mean[axis]);

    glm::vec3 scale;
    for (int axis = 0; axis < 3; ++axis) {
      scale[axis] =
          static_cast<float>(random.magnitude(spec.smallest, spec.largest) * z / static_cast<double>(camera.fx));
    }
    glm::vec4 q;
    for (int k = 0; k < 4; ++k) q[k] = random.real(-1, 1);
    if (spec.covariances) {
      const glm::mat3 axes = glm::mat3_cast(glm::normalize(glm::quat(q[0], q[1], q[2], q[3])));
      const glm::mat3 root = axes * glm::mat3(scale[0], 0, 0, 0, scale[1], 0, 0, 0, scale[2]);
      const glm::mat3 c = root * glm::transpose(root);
      for (const float value : {c[0][0], c[0][1], c[0][2], c[1][1], c[1][2], c[2][2]})
        scene.covariances.push_back(value);
    } else {
      for (int axis = 0; axis < 3; ++axis) scene.scales.push_back(scale[axis]);
      for (int k = 0; k < 4; ++k) scene.rotations.push_back(q[k]);
    }
    scene.opacities.push_back(random.real(spec.opacity_low, spec.opacity_high));
    if (spec.colors) {
      for (int c = 0; c < 3; ++c) scene.colors.push_back(random.real(-0.2, 1.2));
    } else {
      for (int c = 0; c < 3; ++c) scene.sh_dc.push_back(random.real(-1.5, 2.5));
      for (int k = 0; k < 3 * scene.sh_rest_rows; ++k) scene.sh_rest.push_back(random.real(-0.3, 0.3));
    }
    for (int f = 0; f < spec.features; ++f) scene.features.push_back(random.real(-1, 1));
  }
  return scene;
}

inline reference::Camera reference_camera(const Camera& camera) {
  reference::Camera result;
  result.width = camera.width;
  result.height = camera.height;
  result.fx = static_cast<double>(camera.fx);
  result.fy = static_cast<double>(camera.fy);
  result.cx = static_cast<double>(camera.cx);
  result.cy = static_cast<double>(camera.cy);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      result.rotation[static_cast<std::size_t>(row)][static_cast<std::size_t>(column)] =
          static_cast<double>(camera.camera_from_world[column][row]);
    }
    result.translation[static_cast<std::size_t>(row)] = static_cast<double>(camera.camera_from_world[3][row]);
  }
  return result;
}

inline reference::Options reference_options(const RasterOptions& options) {
  reference::Options result;
  result.ellipse = options.box == BoxPolicy::ellipse;
  result.beta = static_cast<double>(options.beta);
  result.low_pass = static_cast<double>(options.low_pass);
  result.compensate_opacity = options.compensate_opacity;
  result.near_plane = static_cast<double>(options.near_plane);
  for (int c = 0; c < 3; ++c)
    result.background[static_cast<std::size_t>(c)] = static_cast<double>(options.background[c]);
  return result;
}

/// The images of one forward pass.
struct ImageData {
  std::vector<float> color, features, inverse_depth, alpha;

  ImageData(const Camera& camera, int feature_count) {
    const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
    const float garbage = std::nanf("");  // so that elements that a pass does not write are noticed
    color.assign(3 * pixels, garbage);
    features.assign(static_cast<std::size_t>(feature_count) * pixels, garbage);
    inverse_depth.assign(pixels, garbage);
    alpha.assign(pixels, garbage);
  }

  RasterImages view() { return {color, features, inverse_depth, alpha}; }
};

/// Requests the colour image only.
inline RasterImages color_only(std::vector<float>& color) {
  RasterImages images;
  images.color = color;
  return images;
}

/// Owns an array for every gradient of the scene.
struct GradientData {
  std::vector<float> means, scales, rotations, covariances, opacities, sh_dc, sh_rest, colors, features, screen_means,
      screen_means_abs;

  explicit GradientData(const SceneData& scene, float value = std::nanf(""))
      : means(scene.means.size(), value),
        scales(scene.scales.size(), value),
        rotations(scene.rotations.size(), value),
        covariances(scene.covariances.size(), value),
        opacities(scene.opacities.size(), value),
        sh_dc(scene.sh_dc.size(), value),
        sh_rest(scene.sh_rest.size(), value),
        colors(scene.colors.size(), value),
        features(scene.features.size(), value),
        screen_means(2 * scene.count, value),
        screen_means_abs(2 * scene.count, value) {}

  std::array<const std::vector<float>*, 11> all() const {
    return {&means,   &scales, &rotations, &covariances,  &opacities,       &sh_dc,
            &sh_rest, &colors, &features,  &screen_means, &screen_means_abs};
  }

  GaussianGradients view(GradientMode mode = GradientMode::overwrite) {
    GaussianGradients g;
    g.mode = mode;
    g.means = means;
    g.scales = scales;
    g.rotations = rotations;
    g.covariances = covariances;
    g.opacities = opacities;
    g.sh_dc = sh_dc;
    g.sh_rest = sh_rest;
    g.colors = colors;
    g.features = features;
    g.screen_means = screen_means;
    g.screen_means_abs = screen_means_abs;
    return g;
  }
};

/// Random dL/d image with both signs.
struct ImageGradientData {
  std::vector<float> color, features, inverse_depth, alpha;

  /// Zero at excluded pixels, so that decisions at thresholds do not affect any gradient.
  ImageGradientData(const Camera& camera, int feature_count, std::uint64_t seed,
                    const std::vector<std::uint8_t>& excluded) {
    Numbers random(seed);
    const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
    const auto fill = [&](std::vector<float>& values, std::size_t planes) {
      for (std::size_t k = 0; k < planes * pixels; ++k) {
        const float value = random.real(-1, 1);
        values.push_back(!excluded.empty() && excluded[k % pixels] != 0 ? 0.0f : value);
      }
    };
    fill(color, 3);
    fill(features, static_cast<std::size_t>(feature_count));
    fill(inverse_depth, 1);
    fill(alpha, 1);
  }

  RasterImageGradients view() const { return {color, features, inverse_depth, alpha}; }

  reference::ImageGradients reference() const {
    const auto copy = [](const std::vector<float>& from) { return std::vector<double>(from.begin(), from.end()); };
    return {copy(color), copy(features), copy(inverse_depth), copy(alpha)};
  }
};

}  // namespace splatboost::test
