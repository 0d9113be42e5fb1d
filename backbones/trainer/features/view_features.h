// SPDX-License-Identifier: Apache-2.0
/// @file A view with a known pose in grey, and its SIFT features.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "trainer/dataset/scene.h"

namespace splatboost {

inline constexpr std::size_t kDescriptorSize = 128;
inline constexpr int kDescriptorLength = 512;  ///< Euclidean norm of a stored descriptor

inline constexpr int kLongestSide = 640;  ///< px, of ViewFeatures

/// A position in a picture.
struct Projected {
  glm::dvec2 pixel{0.0};
  double depth = 0;  ///< z in the view's camera
};

/// A view at the size at which its features were detected, which is smaller than that of a large photo. Pixel (i, j)
/// has its centre at (i + 0.5, j + 0.5).
struct ViewFeatures {
  const View* view = nullptr;
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;
  glm::dmat3 rotation{1.0};  ///< from world to camera
  glm::dvec3 centre{0.0};
  std::vector<std::uint8_t> grey;         ///< [H,W]
  std::vector<std::uint8_t> valid;        ///< [H,W] zero where the photo is masked; empty: nowhere
  std::vector<glm::dvec2> pixels;         ///< [N]
  std::vector<std::uint8_t> descriptors;  ///< [N,128]

  double diagonal() const { return std::hypot(width, height); }  ///< px
  glm::dvec3 forward() const { return glm::transpose(rotation)[2]; }
  glm::dvec3 to_camera(const glm::dvec3& point) const { return rotation * (point - centre); }
  glm::dvec2 project(const glm::dvec3& in_camera) const {
    return {fx * in_camera.x / in_camera.z + cx, fy * in_camera.y / in_camera.z + cy};
  }
  /// Where the picture shows a world position; none if that is not in front of the camera or outside of the picture.
  std::optional<Projected> projected(const glm::dvec3& point) const {
    const glm::dvec3 p = to_camera(point);
    if (!(p.z > 0)) return std::nullopt;
    const glm::dvec2 pixel = project(p);
    if (!(pixel.x >= 0 && pixel.y >= 0 && pixel.x < width && pixel.y < height)) return std::nullopt;
    return Projected{pixel, p.z};
  }
  /// Index of the pixel around a position in the picture.
  std::size_t index_of(const glm::dvec2& pixel) const {
    return static_cast<std::size_t>(pixel.y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(pixel.x);
  }
  /// Direction of a pixel in the camera frame, with z = 1.
  glm::dvec3 normalised(const glm::dvec2& pixel) const { return {(pixel.x - cx) / fx, (pixel.y - cy) / fy, 1}; }
  glm::dvec3 ray(const glm::dvec2& pixel) const { return glm::normalize(glm::transpose(rotation) * normalised(pixel)); }
  /// World position of a pixel at this z.
  glm::dvec3 at_depth(const glm::dvec2& pixel, double z) const {
    return glm::transpose(rotation) * (normalised(pixel) * z) + centre;
  }
  /// Distance of a projected point to a feature, px; infinite behind the camera.
  double error(const glm::dvec3& point, std::size_t feature) const {
    const glm::dvec3 p = to_camera(point);
    return p.z > 0 ? glm::length(project(p) - pixels[feature]) : std::numeric_limits<double>::infinity();
  }
};

/// Detects SIFT features (Lowe 2004), the strongest if there are many, outside masks. Descriptors are normalised as in
/// "Three things everyone should know to improve object retrieval" (Arandjelović and Zisserman 2012). A build without
/// OpenCV detects none: the result is grey_view(). @param view must outlive the result
ViewFeatures detect_features(const View& view);

/// The view in grey, without features. A large photo is reduced by a whole number (smaller_view()).
/// @param view must outlive the result
ViewFeatures grey_view(const View& view);

/// The camera of the view, reduced to a picture of this size, without pixels.
/// @param sx,sy pixels of the picture per pixel of the view
ViewFeatures reduced_camera(const View& view, int width, int height, double sx, double sy);

}  // namespace splatboost
