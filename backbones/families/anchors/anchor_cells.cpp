// SPDX-License-Identifier: Apache-2.0
#include "families/anchors/anchor_cells.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace splatboost {
namespace {

std::vector<Cell> cells_of(const CellGrid& grid, std::span<const float> points) {
  std::vector<Cell> cells(points.size() / 3);
  for (std::size_t i = 0; i < cells.size(); ++i) cells[i] = grid.cell_of(&points[3 * i]);
  return cells;
}

void sort_unique(std::vector<Cell>& cells) {
  std::sort(cells.begin(), cells.end());
  cells.erase(std::unique(cells.begin(), cells.end()), cells.end());
}

}  // namespace

Cell CellGrid::cell_of(const float* point) const {
  constexpr float kFarthest = 9223371487098961920.0f;  // the largest float below 2⁶³
  Cell cell{};
  for (std::size_t c = 0; c < 3; ++c) {
    const float nearest = std::nearbyint((point[c] - origin[c]) / size);
    cell[c] = static_cast<std::int64_t>(std::clamp(nearest, -kFarthest, kFarthest));
  }
  return cell;
}

std::array<float, 3> CellGrid::centre_of(const Cell& cell) const {
  std::array<float, 3> centre{};
  for (std::size_t c = 0; c < 3; ++c) centre[c] = origin[c] + size * static_cast<float>(cell[c]);
  return centre;
}

std::vector<float> occupied_centres(const CellGrid& grid, std::span<const float> points) {
  std::vector<Cell> cells = cells_of(grid, points);
  sort_unique(cells);
  std::vector<float> centres;
  centres.reserve(3 * cells.size());
  for (const Cell& cell : cells) {
    const std::array<float, 3> centre = grid.centre_of(cell);
    centres.insert(centres.end(), centre.begin(), centre.end());
  }
  return centres;
}

NewCells new_cells(const CellGrid& grid, std::span<const float> points, std::span<const float> held) {
  const std::vector<Cell> wanted = cells_of(grid, points);
  std::vector<std::uint32_t> order(wanted.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) { return wanted[a] < wanted[b]; });
  std::vector<Cell> taken = cells_of(grid, held);
  sort_unique(taken);
  NewCells found;
  auto next_taken = taken.begin();
  for (const std::uint32_t i : order) {
    const Cell& cell = wanted[i];
    while (next_taken != taken.end() && *next_taken < cell) ++next_taken;
    if (next_taken != taken.end() && *next_taken == cell) continue;
    if (found.cells.empty() || found.cells.back() != cell) {
      found.cells.push_back(cell);
      found.sources.emplace_back();
    }
    found.sources.back().push_back(i);
  }
  return found;
}

}  // namespace splatboost
