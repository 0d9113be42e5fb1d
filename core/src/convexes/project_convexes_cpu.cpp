// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <vector>

#include "convexes/convex_project.h"

namespace splatboost {
namespace {

ConvexRows rows_of(const Convexes& convexes, std::size_t i) {
  const auto row = [i](std::span<const float> rows, std::size_t width) {
    return rows.empty() ? nullptr : rows.data() + width * i;
  };
  return {row(convexes.points, 3 * static_cast<std::size_t>(convexes.points_per_convex)),
          convexes.points_per_convex,
          convexes.smoothness[i],
          convexes.sharpness[i],
          convexes.opacities[i],
          row(convexes.colors, 3),
          row(convexes.sh_dc, 3),
          row(convexes.sh_rest, 3 * static_cast<std::size_t>(convexes.sh_rest_rows)),
          convexes.sh_degree};
}

void project_range(ConvexFrame& frame, const Convexes& convexes, const ConvexViewpoint& view, std::size_t begin,
                   std::size_t end) {
  std::vector<std::uint32_t>& listed = frame.listed_tiles[begin / kProjectGrain];
  listed.clear();
  for (std::size_t i = begin; i < end; ++i) {
    const std::size_t first = listed.size();
    ConvexTiles tiles;
    if (make_record(rows_of(convexes, i), view, frame.records[i], tiles)) {
      frame.depths[i] = frame.records[i].depth;
      for_tile_rows(tiles, view, [&](int row, int from, int to) {
        for (int column = from; column < to; ++column) {
          listed.push_back(static_cast<std::uint32_t>(row * frame.tiles_x + column));
        }
      });
    }
    check_entries(listed.size());
    frame.listings[i] = {static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(listed.size() - first)};
    frame.visible[i] = frame.listings[i].tiles > 0 ? 1 : 0;
  }
}

/// Writes a row, or adds to it.
void write(std::span<float> rows, bool adds, std::size_t i, const float* values, std::size_t width) {
  if (rows.empty()) return;
  float* const row = rows.data() + width * i;
  for (std::size_t k = 0; k < width; ++k) row[k] = adds ? row[k] + values[k] : values[k];
}

void clear_row(std::span<float> rows, std::size_t i, std::size_t width) {
  if (!rows.empty()) std::fill_n(rows.data() + width * i, width, 0.0f);
}

void clear(const Convexes& convexes, const ConvexGradients& out, std::size_t i) {
  clear_row(out.view_sharpness, i, 1);
  clear_row(out.view_sharpness_abs, i, 1);
  clear_row(out.screen_points, i, 3);
  if (out.mode == GradientMode::accumulate) return;
  clear_row(out.points, i, 3 * static_cast<std::size_t>(convexes.points_per_convex));
  clear_row(out.smoothness, i, 1);
  clear_row(out.sharpness, i, 1);
  clear_row(out.opacities, i, 1);
  clear_row(out.sh_dc, i, 3);
  clear_row(out.sh_rest, i, 3 * static_cast<std::size_t>(convexes.sh_rest_rows));
  clear_row(out.colors, i, 3);
}

void backward_one(const ConvexFrame& frame, const Convexes& convexes, const ConvexViewpoint& view,
                  const ConvexGradients& out, std::size_t i) {
  // Sums over the lists' entries, in their order.
  constexpr std::size_t kWidth = sizeof(ConvexMoments) / sizeof(float);
  alignas(64) float total[kWidth] = {};
  const std::size_t slot = frame.first_slot(i);
  for (std::uint32_t t = 0; t < frame.listings[i].tiles; ++t) {
    const auto* const entry = reinterpret_cast<const float*>(&frame.entry_moments[slot + t]);
    for (std::size_t k = 0; k < kWidth; ++k) total[k] += entry[k];
  }
  // Most of those that lie behind others moved nothing.
  if (std::all_of(total, total + kWidth, [](float sum) { return sum == 0.0f; })) return clear(convexes, out, i);
  const ConvexRowGradients g =
      gradients_of(rows_of(convexes, i), view, frame.records[i], *reinterpret_cast<const ConvexMoments*>(total));
  const bool adds = out.mode == GradientMode::accumulate;
  write(out.points, adds, i, &g.geometry.points[0][0], 3 * static_cast<std::size_t>(convexes.points_per_convex));
  write(out.smoothness, adds, i, &g.geometry.smoothness, 1);
  write(out.sharpness, adds, i, &g.geometry.sharpness, 1);
  write(out.opacities, adds, i, &g.opacity, 1);
  write(out.view_sharpness, false, i, &g.geometry.sharpness, 1);
  write(out.view_sharpness_abs, false, i, &g.view_sharpness_abs, 1);
  write(out.screen_points, false, i, g.geometry.screen, 3);
  if (!convexes.colors.empty()) {
    write(out.colors, adds, i, g.color, 3);
    return;
  }
  float coefficients[3 * kMaxShCoefficients];
  const auto used = static_cast<std::size_t>(sh_coefficients(convexes.sh_degree));
  for (std::size_t k = 0; k < 3 * used; ++k) coefficients[k] = g.sh_basis[k / 3] * g.color[k % 3];
  write(out.sh_dc, adds, i, coefficients, 3);
  if (out.sh_rest.empty()) return;
  const std::size_t width = 3 * static_cast<std::size_t>(convexes.sh_rest_rows);
  float* const row = out.sh_rest.data() + width * i;
  for (std::size_t k = 0; k < width; ++k) {
    const float value = k + 3 < 3 * used ? coefficients[k + 3] : 0.0f;
    row[k] = adds ? row[k] + value : value;
  }
}

}  // namespace

void project_convexes(ConvexFrame& frame, const Convexes& convexes, Threads& threads) {
  const std::size_t n = convexes.count;
  frame.records.ensure(n);
  frame.depths.ensure(n);
  frame.visible.ensure(n);
  frame.listings.ensure(n);
  if (frame.listed_tiles.size() < frame.pieces()) frame.listed_tiles.resize(frame.pieces());
  const ConvexViewpoint view = make_viewpoint(frame.camera, frame.options);
  threads.for_range(n, kProjectGrain,
                    [&](std::size_t begin, std::size_t end) { project_range(frame, convexes, view, begin, end); });
}

void project_convexes_backward(const ConvexFrame& frame, const Convexes& convexes, const ConvexGradients& gradients,
                               Threads& threads) {
  const ConvexViewpoint view = make_viewpoint(frame.camera, frame.options);
  threads.for_range(frame.primitives, kProjectGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      frame.visible[i] != 0 ? backward_one(frame, convexes, view, gradients, i) : clear(convexes, gradients, i);
    }
  });
}

}  // namespace splatboost
