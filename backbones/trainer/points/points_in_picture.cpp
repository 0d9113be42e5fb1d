// SPDX-License-Identifier: Apache-2.0
#include "trainer/points/points_in_picture.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <utility>

#include <glm/geometric.hpp>

namespace splatboost {
namespace {
constexpr std::size_t kBlock = 1 << 16;
constexpr double kNarrowestSpacing = 2;  ///< px
constexpr int kLikeBackground = 8;       ///< grey values

std::size_t count_of(int size, double spacing) {
  return static_cast<std::size_t>(std::max(0.0, std::ceil(size / spacing - 0.5)));
}
}  // namespace

PictureGrid::PictureGrid(const ViewFeatures& view, double spacing_of_diagonal)
    : spacing(std::max(kNarrowestSpacing, spacing_of_diagonal * view.diagonal())),
      columns(count_of(view.width, spacing)),
      rows(count_of(view.height, spacing)) {}

bool is_valid(const ViewFeatures& view, const glm::dvec2& pixel) {
  return view.valid.empty() || view.valid[view.index_of(pixel)] != 0;
}

bool needs_points(const ViewFeatures& view, const glm::dvec2& pixel, std::uint8_t background) {
  return is_valid(view, pixel) && std::abs(view.grey[view.index_of(pixel)] - background) > kLikeBackground;
}

PointsInPicture::PointsInPicture(const ViewFeatures& view, double cell)
    : view_(view),
      cell_(cell),
      columns_(static_cast<std::size_t>(view.width / cell) + 1),
      rows_(static_cast<std::size_t>(view.height / cell) + 1),
      cells_(columns_ * rows_) {}

void PointsInPicture::add(std::span<const glm::dvec3> positions, const Threads& threads) {
  // Projected in parallel, block by block.
  std::vector<std::optional<Projected>> block(std::min(positions.size(), kBlock));
  for (std::size_t begin = 0; begin < positions.size(); begin += kBlock) {
    const std::size_t size = std::min(kBlock, positions.size() - begin);
    threads.for_range(size, 1024, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i) block[i] = view_.projected(positions[begin + i]);
    });
    for (std::size_t i = 0; i < size; ++i) {
      if (block[i]) cells_[row_of(block[i]->pixel) * columns_ + column_of(block[i]->pixel)].push_back(*block[i]);
    }
  }
}

std::vector<double> PointsInPicture::depths_near(const glm::dvec2& pixel, double reach, std::size_t count) const {
  std::vector<std::pair<double, double>> near;  // distance, depth
  for_each_within(pixel, reach, [&](double distance, double depth) { near.emplace_back(distance, depth); });
  const std::size_t found = std::min(count, near.size());
  std::ranges::partial_sort(near, near.begin() + static_cast<std::ptrdiff_t>(found));
  std::vector<double> depths;
  for (std::size_t i = 0; i < found; ++i) depths.push_back(near[i].second);
  return depths;
}

bool PointsInPicture::shows_any(const glm::dvec2& pixel, double reach) const {
  bool any = false;
  for_each_within(pixel, reach, [&](double, double) { any = true; });
  return any;
}

std::size_t PointsInPicture::column_of(const glm::dvec2& pixel) const {
  return std::min(static_cast<std::size_t>(std::max(pixel.x, 0.0) / cell_), columns_ - 1);
}

std::size_t PointsInPicture::row_of(const glm::dvec2& pixel) const {
  return std::min(static_cast<std::size_t>(std::max(pixel.y, 0.0) / cell_), rows_ - 1);
}

template <class Visit>
void PointsInPicture::for_each_within(const glm::dvec2& pixel, double reach, Visit&& visit) const {
  for (std::size_t row = row_of(pixel - reach); row <= row_of(pixel + reach); ++row) {
    for (std::size_t column = column_of(pixel - reach); column <= column_of(pixel + reach); ++column) {
      for (const Projected& shown : cells_[row * columns_ + column]) {
        const double distance = glm::length(shown.pixel - pixel);
        if (distance < reach) visit(distance, shown.depth);
      }
    }
  }
}

}  // namespace splatboost
