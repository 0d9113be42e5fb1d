// SPDX-License-Identifier: Apache-2.0
/// @file Pixels of a picture that need points, and the points that it shows.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "splatboost/threads.h"
#include "trainer/features/view_features.h"

namespace splatboost {

/// Pixels of a picture at regular distances.
struct PictureGrid {
  double spacing;  ///< px
  std::size_t columns, rows;

  /// @param spacing_of_diagonal × diagonal of the picture; pixels are at least two apart
  PictureGrid(const ViewFeatures& view, double spacing_of_diagonal);
  glm::dvec2 pixel(std::size_t row, std::size_t column) const {
    return spacing * (glm::dvec2(static_cast<double>(column), static_cast<double>(row)) + glm::dvec2(0.5));
  }
};

/// Whether a pixel is outside of a view's mask.
bool is_valid(const ViewFeatures& view, const glm::dvec2& pixel);

/// Whether a photo shows something at a pixel that needs points: not where it is masked, nor where its grey value
/// is nearly that of renders without Gaussians. @param background that grey value
bool needs_points(const ViewFeatures& view, const glm::dvec2& pixel, std::uint8_t background);

/// The points that a picture shows, in square cells, so that those around a pixel are found. Every point in front of
/// the camera whose projection lies in the picture counts as shown, also behind others.
class PointsInPicture {
 public:
  /// @param view must outlive this @param cell px
  PointsInPicture(const ViewFeatures& view, double cell);

  /// @param positions world
  void add(std::span<const glm::dvec3> positions, const Threads& threads);

  /// Depths of at most `count` points within `reach` px, those of the nearest in the picture first.
  std::vector<double> depths_near(const glm::dvec2& pixel, double reach, std::size_t count) const;
  bool shows_any(const glm::dvec2& pixel, double reach) const;

 private:
  std::size_t column_of(const glm::dvec2& pixel) const;
  std::size_t row_of(const glm::dvec2& pixel) const;
  template <class Visit>
  void for_each_within(const glm::dvec2& pixel, double reach, Visit&& visit) const;

  const ViewFeatures& view_;
  double cell_;
  std::size_t columns_, rows_;
  std::vector<std::vector<Projected>> cells_;
};

}  // namespace splatboost
