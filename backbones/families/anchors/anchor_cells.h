// SPDX-License-Identifier: Apache-2.0
/// @file Grids whose cell centres are anchor positions: rounding to cells, and finding new cells.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace splatboost {

using Cell = std::array<std::int64_t, 3>;

/// A grid of cubes; cell (a, b, c) has its centre at origin + size·(a, b, c).
struct CellGrid {
  float size = 1;
  std::array<float, 3> origin{0, 0, 0};

  /// Nearest cell, halves to even. Distant points are clamped to the cells that 64-bit indices can represent.
  Cell cell_of(const float* point) const;
  std::array<float, 3> centre_of(const Cell& cell) const;
};

/// Centres of the cells that hold points, each once, in ascending order of cells. [M,3]
std::vector<float> occupied_centres(const CellGrid& grid, std::span<const float> points);

/// Cells that contain candidates but no anchor yet.
struct NewCells {
  std::vector<Cell> cells;                          ///< [C] ascending
  std::vector<std::vector<std::uint32_t>> sources;  ///< [C] candidates in each, ascending
};

/// @param points [P,3] candidates
/// @param held [N,3] existing anchors, whose cells are occupied
NewCells new_cells(const CellGrid& grid, std::span<const float> points, std::span<const float> held);

}  // namespace splatboost
