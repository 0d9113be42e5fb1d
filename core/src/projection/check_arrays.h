// SPDX-License-Identifier: Apache-2.0
/// @file Checks of the arrays and image sizes that callers pass to a rasterizer. All throw ArgumentError that names
/// them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "splatboost/camera.h"
#include "splatboost/constants.h"
#include "splatboost/errors.h"

namespace splatboost {

/// Numbers of tiles are computed as floats and as products of ints, which are exact up to 2^24.
inline void check_image_size(const Camera& camera) {
  SPLATBOOST_CHECK(camera.tiles_x() < 65536 && camera.tiles_y() < 65536, "images are limited to 2^20 pixels per side");
  SPLATBOOST_CHECK(std::int64_t{camera.tiles_x()} * camera.tiles_y() <= std::int64_t{1} << 24,
                   "images are limited to 2^24 tiles of 16 x 16 pixels");
}

inline void check_rows(std::span<const float> rows, std::size_t n, std::size_t width, const char* name) {
  SPLATBOOST_CHECK(rows.size() == n * width, std::string(name) + " must hold " + std::to_string(n) + " × " +
                                                 std::to_string(width) + " numbers, not " +
                                                 std::to_string(rows.size()));
}

inline void check_optional(std::span<const float> values, std::size_t size, const char* name) {
  SPLATBOOST_CHECK(values.empty() || values.size() == size, std::string(name) + " must be empty or hold " +
                                                                std::to_string(size) + " numbers, not " +
                                                                std::to_string(values.size()));
}

/// Checks the spherical harmonics or colours of Gaussians or of convexes.
template <class Primitives>
void check_colors(const Primitives& p) {
  SPLATBOOST_CHECK(p.colors.empty() != p.sh_dc.empty(), "give either spherical harmonics (sh_dc, sh_rest) or colors");
  if (!p.colors.empty()) return check_rows(p.colors, p.count, 3, "colors");
  check_rows(p.sh_dc, p.count, 3, "sh_dc");
  SPLATBOOST_CHECK(p.sh_degree >= 0 && p.sh_degree <= kMaxShDegree, "sh_degree must be 0 to 3");
  SPLATBOOST_CHECK(p.sh_rest_rows >= sh_coefficients(p.sh_degree) - 1, "sh_rest_rows is too small for sh_degree");
  check_rows(p.sh_rest, p.count, 3 * static_cast<std::size_t>(p.sh_rest_rows), "sh_rest");
}

}  // namespace splatboost
