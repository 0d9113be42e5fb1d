// SPDX-License-Identifier: Apache-2.0
/// @file Space that the photos show to be empty.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "splatboost/threads.h"
#include "trainer/features/view_features.h"

namespace splatboost {

/// Space between the cameras and the surfaces that they see. These are known where points lie around a pixel.
class FreeSpace {
 public:
  /// @param views must outlive this
  /// @param known points on surfaces, world
  /// @param spacing × diagonal of a picture; known points within one to two times this distance are around a pixel
  FreeSpace(const std::vector<ViewFeatures>& views, std::span<const glm::dvec3> known, double spacing,
            const Threads& threads);

  /// Whether a surface at this depth of a pixel would hide what another view shows: that view has other grey values
  /// there, and all known points around are behind.
  bool contains(std::size_t view, const glm::dvec2& pixel, double depth) const;

 private:
  /// Depth of the nearest known point in each cell of a picture; infinite where there is none.
  struct Nearest {
    double cell = 0;  ///< px
    std::size_t columns = 0, rows = 0;
    std::vector<float> depths;  ///< [rows,columns]

    /// In the cells around a pixel.
    float around(const glm::dvec2& pixel) const;
  };

  const std::vector<ViewFeatures>& views_;
  std::vector<Nearest> nearest_;  ///< of each view
};

}  // namespace splatboost
