// SPDX-License-Identifier: Apache-2.0
/// @file Two cameras over a textured plane, with planes blended per pixel, and a plain double-precision version of the
/// surface loss.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/mat4x4.hpp>

#include "splatboost/random.h"
#include "splatboost/surface_loss.h"
#include "support/looking_camera.h"

namespace splatboost::testing {

inline glm::dvec3 ray_of(const Camera& camera, std::size_t pixel) {
  const auto width = static_cast<std::size_t>(camera.width);
  const double x = static_cast<double>(pixel % width) + 0.5, y = static_cast<double>(pixel / width) + 0.5;
  return {(x - static_cast<double>(camera.cx)) / static_cast<double>(camera.fx),
          (y - static_cast<double>(camera.cy)) / static_cast<double>(camera.fy), 1};
}

struct SurfaceScene {
  static constexpr int kWidth = 20, kHeight = 16;
  glm::dvec3 normal = glm::normalize(glm::dvec3(0.9, -0.2, 0.5));  ///< towards the cameras
  double offset = 0.1;                                             ///< normal · point
  Camera cameras[2] = {camera_looking_at_origin({3, -0.5f, 1.2f}, kWidth, kHeight),
                       camera_looking_at_origin({2.9f, -0.7f, 1.6f}, kWidth, kHeight)};
  std::vector<float> planes[2], alphas[2];
  std::vector<std::uint8_t> photos[2];
  std::vector<std::uint8_t> valid[2];  ///< masks of the photos; empty: none
  Camera patch_cameras[2] = {cameras[0], cameras[1]};
  std::vector<std::uint8_t> patch_photos[2];  ///< those in which patches are compared
  std::optional<PatchPhoto> patches[2];       ///< if they are not `photos`

  /// @param noise standard deviation of noise per pixel, added to the normal and, relatively, to the distance
  explicit SurfaceScene(double noise) {
    const RandomStream numbers(1, 0, RandomPurpose::synth);
    std::uint64_t next = 0;
    for (std::size_t v = 0; v < 2; ++v) {
      const glm::dmat4 camera_from_world(cameras[v].camera_from_world);
      const glm::dmat3 rotation(camera_from_world);
      const glm::dvec3 centre = -(glm::transpose(rotation) * glm::dvec3(camera_from_world[3]));
      planes[v].resize(4 * pixels());
      for (std::size_t p = 0; p < pixels(); ++p) {
        const double alpha = 0.6 + 0.4 * numbers.uniform(next++);
        alphas[v].push_back(static_cast<float>(alpha));
        const glm::dvec3 local = rotation * normal;
        const double distance = glm::dot(normal, centre) - offset;
        for (int c = 0; c < 3; ++c) {
          planes[v][static_cast<std::size_t>(c) * pixels() + p] =
              static_cast<float>(alpha * (local[c] + noise * numbers.normal(next++)));
        }
        planes[v][3 * pixels() + p] = static_cast<float>(alpha * distance * (1 + noise * numbers.normal(next++)));
      }
      photos[v] = patch_photos[v] = photo_of(cameras[v]);
    }
  }
  /// Masks the left of the first photo, the top of the second, and a pixel in each.
  void mask_pixels() {
    for (std::size_t v = 0; v < 2; ++v) {
      valid[v].assign(pixels(), 1);
      for (std::size_t p = 0; p < pixels(); ++p) {
        if (v == 0 ? p % kWidth < 3 : p / kWidth < 2) valid[v][p] = 0;
      }
    }
    valid[0][14 * kWidth + 18] = valid[1][8 * kWidth + 17] = 0;
  }
  /// Compares patches in photos of this size.
  void take_patch_photos(int width, int height) {
    for (std::size_t v = 0; v < 2; ++v) {
      Camera& camera = patch_cameras[v];
      camera.width = width;
      camera.height = height;
      camera.fx *= static_cast<float>(width) / kWidth;
      camera.cx *= static_cast<float>(width) / kWidth;
      camera.fy *= static_cast<float>(height) / kHeight;
      camera.cy *= static_cast<float>(height) / kHeight;
      patch_photos[v] = photo_of(camera);
      patches[v].emplace(PatchPhoto{camera, {width, height, patch_photos[v], {}}});
    }
  }
  /// The textured plane from the camera.
  std::vector<std::uint8_t> photo_of(const Camera& camera) const {
    const auto count = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
    const glm::dmat4 camera_from_world(camera.camera_from_world);
    const glm::dmat3 rotation(camera_from_world);
    const glm::dvec3 centre = -(glm::transpose(rotation) * glm::dvec3(camera_from_world[3]));
    std::vector<std::uint8_t> photo(3 * count);
    for (std::size_t p = 0; p < count; ++p) {
      const glm::dvec3 ray = glm::transpose(rotation) * ray_of(camera, p);
      const glm::dvec3 point = centre + (offset - glm::dot(normal, centre)) / glm::dot(normal, ray) * ray;
      for (std::size_t c = 0; c < 3; ++c) {
        const double phase = static_cast<double>(c);
        const double texture = 0.5 + 0.2 * std::sin(4 * point.x + 6 * point.y + phase) +
                               0.2 * std::cos(5 * point.z - 3 * point.y + 2 * phase);
        photo[c * count + p] = static_cast<std::uint8_t>(std::lround(255 * texture));
      }
    }
    return photo;
  }
  static std::size_t pixels() { return static_cast<std::size_t>(kWidth) * kHeight; }
  SurfaceView view(std::size_t v, std::vector<float>& gradients) const {
    TruthImage truth;
    if (!photos[v].empty()) truth = {kWidth, kHeight, photos[v], valid[v]};
    return {cameras[v], truth, planes[v], alphas[v], gradients, patches[v] ? &*patches[v] : nullptr};
  }
  static RandomStream random() { return {2, 3, RandomPurpose::synth}; }
};

/// Values that get no gradient: fixed in the first evaluation and reused in later ones.
struct Frozen {
  bool set = false;
  std::vector<double> weights;       ///< [H·W] e^−noise; 0 where the two views disagree
  std::vector<std::uint8_t> counts;  ///< [H·W] 1 where the patch around a pixel is used
  double agreeing = 0, patches = 0;
};

/// The loss of SurfaceLoss if max_patches exceeds the number of pixels.
inline double plain_surface_loss(const SurfaceScene& scene, const std::vector<double>& first,
                                 const std::vector<double>& second, const SurfaceTerms& terms, Frozen& frozen) {
  using glm::dvec2;
  using glm::dvec3;
  constexpr int kWidth = SurfaceScene::kWidth, kHeight = SurfaceScene::kHeight;
  const std::size_t pixels = SurfaceScene::pixels();
  const auto index = [](int x, int y) {
    return static_cast<std::size_t>(std::clamp(y, 0, kHeight - 1)) * kWidth +
           static_cast<std::size_t>(std::clamp(x, 0, kWidth - 1));
  };
  const auto normal_at = [&](const std::vector<double>& planes, std::size_t p) {
    return dvec3(planes[p], planes[pixels + p], planes[2 * pixels + p]);
  };
  const auto depths_of = [&](const std::vector<double>& planes, const Camera& camera) {
    std::vector<double> depth;
    for (std::size_t p = 0; p < pixels; ++p) {
      depth.push_back(-planes[3 * pixels + p] / glm::dot(normal_at(planes, p), ray_of(camera, p)));
    }
    return depth;
  };
  const auto sampled = [&](const std::vector<double>& image, dvec2 at) {
    const double x = std::clamp(at.x - 0.5, 0.0, kWidth - 1.0), y = std::clamp(at.y - 0.5, 0.0, kHeight - 1.0);
    const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
    const double u = x - x0, v = y - y0;
    return (1 - v) * ((1 - u) * image[index(x0, y0)] + u * image[index(x0 + 1, y0)]) +
           v * ((1 - u) * image[index(x0, y0 + 1)] + u * image[index(x0 + 1, y0 + 1)]);
  };
  const Camera &a = scene.cameras[0], &b = scene.cameras[1];
  const auto project = [](const Camera& camera, dvec3 point) {
    return dvec2(static_cast<double>(camera.fx) * point.x / point.z + static_cast<double>(camera.cx),
                 static_cast<double>(camera.fy) * point.y / point.z + static_cast<double>(camera.cy));
  };
  const auto ray_at = [](const Camera& camera, dvec2 at) {
    return dvec3((at.x - static_cast<double>(camera.cx)) / static_cast<double>(camera.fx),
                 (at.y - static_cast<double>(camera.cy)) / static_cast<double>(camera.fy), 1);
  };
  const glm::dmat4 world_from_a = glm::inverse(glm::dmat4(a.camera_from_world));
  const glm::dmat4 b_from_a = glm::dmat4(b.camera_from_world) * world_from_a, a_from_b = glm::inverse(b_from_a);
  const auto moved = [](const glm::dmat4& by, dvec3 point) { return dvec3(by * glm::dvec4(point, 1)); };
  const std::vector<double> depth_a = depths_of(first, a), depth_b = depths_of(second, b);
  const auto masked = [&](std::size_t v, std::size_t p) { return !scene.valid[v].empty() && scene.valid[v][p] == 0; };
  double loss = 0;

  std::vector<double> edges(pixels, 0.0);
  double least = 1e9, greatest = 0;
  const auto& photo = scene.photos[0];
  for (int y = 1; y + 1 < kHeight; ++y) {
    for (int x = 1; x + 1 < kWidth; ++x) {
      double dx = 0, dy = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        const auto value = [&](int i, int j) { return static_cast<double>(photo[c * pixels + index(i, j)]); };
        dx += std::abs(value(x + 1, y) - value(x - 1, y)) / 3;
        dy += std::abs(value(x, y + 1) - value(x, y - 1)) / 3;
      }
      edges[index(x, y)] = std::max(dx, dy);
      if (masked(0, index(x, y)) || masked(0, index(x - 1, y)) || masked(0, index(x + 1, y)) ||
          masked(0, index(x, y - 1)) || masked(0, index(x, y + 1))) {
        continue;
      }
      least = std::min(least, edges[index(x, y)]);
      greatest = std::max(greatest, edges[index(x, y)]);
    }
  }
  for (int y = 1; y + 1 < kHeight; ++y) {
    for (int x = 1; x + 1 < kWidth; ++x) {
      if (masked(0, index(x, y))) continue;
      const auto point = [&](int i, int j) { return depth_a[index(i, j)] * ray_of(a, index(i, j)); };
      const dvec3 normal =
          glm::normalize(glm::cross(point(x + 1, y) - point(x - 1, y), point(x, y - 1) - point(x, y + 1)));
      const std::size_t p = index(x, y);
      const dvec3 gap = static_cast<double>(scene.alphas[0][p]) * normal - normal_at(first, p);
      const double rest = 1 - std::clamp((edges[p] - least) / (greatest - least), 0.0, 1.0);
      loss += static_cast<double>(terms.normal_weight) / static_cast<double>(pixels) * rest * rest *
              (std::abs(gap.x) + std::abs(gap.y) + std::abs(gap.z));
    }
  }

  std::vector<double> noise(pixels, 0.0);
  const bool fresh = !frozen.set;
  if (fresh) {
    frozen.weights.assign(pixels, 0.0);
    frozen.counts.assign(pixels, 0);
  }
  for (std::size_t p = 0; p < pixels; ++p) {
    const dvec3 there = moved(b_from_a, depth_a[p] * ray_of(a, p));
    const dvec2 at = project(b, there);
    const dvec3 back = moved(a_from_b, sampled(depth_b, at) * ray_at(b, at));
    noise[p] = glm::length(project(a, back) - project(a, ray_of(a, p)));
    const bool inside = at.x >= 0 && at.y >= 0 && at.x < kWidth && at.y < kHeight;
    const bool both = inside && !masked(0, p) && !masked(1, index(static_cast<int>(at.x), static_cast<int>(at.y)));
    if (fresh && both && noise[p] < static_cast<double>(terms.max_pixel_noise)) {
      frozen.weights[p] = std::exp(-noise[p]);
      ++frozen.agreeing;
    }
  }
  for (std::size_t p = 0; p < pixels; ++p) {
    loss += static_cast<double>(terms.geometric_weight) / frozen.agreeing * frozen.weights[p] * noise[p];
  }

  if (terms.photometric_weight > 0) {
    const Camera &photo_a = scene.patch_cameras[0], &photo_b = scene.patch_cameras[1];
    const int width = photo_a.width, height = photo_a.height;
    const auto grey = [&](std::size_t v, int x, int y) {
      const auto& color = scene.patch_photos[v];
      const std::size_t p = static_cast<std::size_t>(std::clamp(y, 0, height - 1) * width) +
                            static_cast<std::size_t>(std::clamp(x, 0, width - 1));
      const std::size_t count = color.size() / 3;
      if (!scene.valid[v].empty() && scene.valid[v][p] == 0) return std::nan("");  // of photos of the size of the views
      return (0.299 * color[p] + 0.587 * color[count + p] + 0.114 * color[2 * count + p]) / 255;
    };
    const auto grey_at = [&](dvec2 at) {  // in the second photo
      const double x = std::clamp(at.x - 0.5, 0.0, width - 1.0), y = std::clamp(at.y - 0.5, 0.0, height - 1.0);
      const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
      const double u = x - x0, v = y - y0;
      return (1 - v) * ((1 - u) * grey(1, x0, y0) + u * grey(1, x0 + 1, y0)) +
             v * ((1 - u) * grey(1, x0, y0 + 1) + u * grey(1, x0 + 1, y0 + 1));
    };
    std::vector<double> losses(pixels, 0.0);
    for (std::size_t p = 0; p < pixels; ++p) {
      if (frozen.weights[p] == 0) continue;
      const dvec3 n = normal_at(first, p);
      const double d = first[3 * pixels + p];
      const int column = static_cast<int>((static_cast<int>(p) % kWidth + 0.5) * width / kWidth);
      const int row = static_cast<int>((static_cast<int>(p) / kWidth + 0.5) * height / kHeight);
      std::vector<double> mine, theirs;
      for (int j = -3; j <= 3; ++j) {
        for (int i = -3; i <= 3; ++i) {
          const int x = column + i, y = row + j;
          const dvec3 ray = ray_at(photo_a, dvec2(x + 0.5, y + 0.5));
          const dvec3 point = -d / glm::dot(n, ray) * ray;
          mine.push_back(grey(0, x, y));
          theirs.push_back(grey_at(project(photo_b, moved(b_from_a, point))));
        }
      }
      const auto covariance = [](const std::vector<double>& s, const std::vector<double>& t) {
        double mean_s = 0, mean_t = 0, sum = 0;
        for (std::size_t k = 0; k < s.size(); ++k) {
          mean_s += s[k] / 49;
          mean_t += t[k] / 49;
        }
        for (std::size_t k = 0; k < s.size(); ++k) sum += (s[k] - mean_s) * (t[k] - mean_t) / 49;
        return sum;
      };
      const double both = covariance(mine, theirs);
      losses[p] = 1 - both * both / (covariance(mine, mine) * covariance(theirs, theirs) + 1e-8);
      if (fresh && losses[p] < 0.9) {
        frozen.counts[p] = 1;
        ++frozen.patches;
      }
    }
    for (std::size_t p = 0; p < pixels; ++p) {
      if (frozen.counts[p] != 0) {
        loss += static_cast<double>(terms.photometric_weight) / frozen.patches * frozen.weights[p] * losses[p];
      }
    }
  }
  frozen.set = true;
  return loss;
}

}  // namespace splatboost::testing
