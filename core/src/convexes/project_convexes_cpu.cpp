// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <vector>

#include <hwy/highway.h>  // for the namespace that the formulas live in; plain floats here

#include "convexes/convex_frame.h"
#include "projection/sh_math.h"
#include "projection/tile_math.h"

namespace splatboost {
namespace {

namespace math = HWY_NAMESPACE;
using math::Vec3;

/// Behind every edge of a hull.
constexpr float kNeverNear = -1e30f;

const float* points_of(const Convexes& convexes, std::size_t i) {
  return convexes.points.data() + 3 * static_cast<std::size_t>(convexes.points_per_convex) * i;
}

/// Where the camera looks at a convex from.
struct Ray {
  Vec3<float> direction;
  float inverse_length;
};

Ray ray_to(const Convexes& convexes, std::size_t i, const ConvexFrame& frame) {
  float centre[3] = {0.0f, 0.0f, 0.0f};
  const float* const points = points_of(convexes, i);
  for (int k = 0; k < convexes.points_per_convex; ++k) {
    for (int c = 0; c < 3; ++c) centre[c] += points[3 * k + c];
  }
  for (float& c : centre) c /= static_cast<float>(convexes.points_per_convex);
  if (frame.options.released_view_direction) centre[0] = centre[1] = centre[2];
  const float* const eye = frame.projection.centre;
  const Vec3<float> ray{centre[0] - eye[0], centre[1] - eye[1], centre[2] - eye[2]};
  const float inverse_length = 1.0f / sqrt_of(math::dot(ray, ray));
  return {inverse_length * ray, inverse_length};
}

void color_of(const Convexes& convexes, std::size_t i, const ConvexFrame& frame, float (&color)[3]) {
  if (!convexes.colors.empty()) {
    std::copy_n(convexes.colors.data() + 3 * i, 3, color);
    return;
  }
  float basis[kMaxShCoefficients];
  math::sh_basis(convexes.sh_degree, ray_to(convexes, i, frame).direction, basis);
  const float* const rest = convexes.sh_rest.data() + 3 * static_cast<std::size_t>(convexes.sh_rest_rows) * i;
  for (std::size_t c = 0; c < 3; ++c) color[c] = 0.5f + basis[0] * convexes.sh_dc[3 * i + c];
  for (int k = 1; k < sh_coefficients(convexes.sh_degree); ++k) {
    for (int c = 0; c < 3; ++c) color[c] += basis[k] * rest[3 * (k - 1) + c];
  }
  for (float& c : color) c = max_of(c, 0.0f);
}

void list_square(const ConvexFrame& frame, const ProjectedConvex& p, float radius, std::vector<std::uint32_t>& listed) {
  const auto x = math::square_tiles(p.centre_x, radius, frame.tiles_x);
  const auto y = math::square_tiles(p.centre_y, radius, frame.tiles_y);
  for (auto row = static_cast<int>(y.begin); row < static_cast<int>(y.end); ++row) {
    for (auto column = static_cast<int>(x.begin); column < static_cast<int>(x.end); ++column) {
      listed.push_back(static_cast<std::uint32_t>(row * frame.tiles_x + column));
    }
  }
}

void list_footprint(const ConvexFrame& frame, const ConvexFootprint& footprint, std::vector<std::uint32_t>& listed) {
  if (footprint.corners == 0) return;
  const Extent height = height_of(footprint);
  const auto rows = math::tiles_meeting(height.low, height.high, frame.tiles_y);
  for (auto row = static_cast<int>(rows.begin); row < static_cast<int>(rows.end); ++row) {
    const float top = static_cast<float>(row * kTileSize) + 0.5f;
    const Extent width = width_within(footprint, top, top + (kTileSize - 1));
    const auto columns = math::tiles_meeting(width.low, width.high, frame.tiles_x);
    for (auto column = static_cast<int>(columns.begin); column < static_cast<int>(columns.end); ++column) {
      listed.push_back(static_cast<std::uint32_t>(row * frame.tiles_x + column));
    }
  }
}

/// @return whether the convex may be drawn; lists its tiles
bool project_one(ConvexFrame& frame, const Convexes& convexes, std::size_t i, std::vector<std::uint32_t>& listed) {
  const ConvexOptions& options = frame.options;
  const float opacity = convexes.opacities[i];
  if (!(opacity > kMinAlpha)) return false;
  const ProjectedConvex p =
      project_convex(frame.projection, points_of(convexes, i), convexes.points_per_convex, options.near_plane);
  if (!p.valid) return false;
  const float scale = p.depth * convexes.smoothness[i] * options.pixel_size * options.pixel_size;
  const float steepness = p.depth * convexes.sharpness[i];
  if (!(scale > 0.0f && scale < 1e30f && steepness > 0.0f && steepness < 1e30f)) return false;
  const float farthest = farthest_of(opacity, steepness);
  if (options.box == ConvexBox::square) {
    const float radius = released_radius(p, 2.1f / (scale * steepness));
    if (radius <= 0.0f) return false;
    list_square(frame, p, radius, listed);
  } else {
    // What is drawn inside the hull alone does not shrink with β.
    const float reach = farthest > 0.0f ? options.beta * farthest : farthest;
    list_footprint(frame, footprint_of(p, scale, reach, frame.camera.width, frame.camera.height), listed);
  }

  ConvexRecord& record = frame.records[i];
  record.centre_x = p.centre_x;
  record.centre_y = p.centre_y;
  record.steepness = steepness;
  record.opacity = opacity;
  record.farthest = kLog2E * (farthest + 1e-4f * abs_of(farthest));
  float color[3];
  color_of(convexes, i, frame, color);
  record.red = color[0];
  record.green = color[1];
  record.blue = color[2];
  record.edges = static_cast<std::uint32_t>(p.edges);
  std::copy_n(p.hull, p.edges, record.hull);
  for (int k = 0; k < kMaxConvexPoints; ++k) {
    const HullEdge edge = k < p.edges ? hull_edge(p, k) : HullEdge{0.0f, 0.0f, 0.0f};
    record.edge_x[k] = kLog2E * scale * edge.x;
    record.edge_y[k] = kLog2E * scale * edge.y;
    record.edge_offset[k] = k < p.edges ? kLog2E * scale * edge.offset : kNeverNear;
  }
  frame.depths[i] = p.depth;
  return true;
}

void project_range(ConvexFrame& frame, const Convexes& convexes, std::size_t begin, std::size_t end) {
  std::vector<std::uint32_t>& listed = frame.listed_tiles[begin / kProjectGrain];
  listed.clear();
  for (std::size_t i = begin; i < end; ++i) {
    const std::size_t first = listed.size();
    project_one(frame, convexes, i, listed);
    check_entries(listed.size());
    frame.listings[i] = {static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(listed.size() - first)};
    frame.visible[i] = frame.listings[i].tiles > 0 ? 1 : 0;
  }
}

/// Writes a row, or adds to it.
struct RowWriter {
  bool adds;
  void operator()(std::span<float> rows, std::size_t i, const float* values, std::size_t width) const {
    if (rows.empty()) return;
    float* const row = rows.data() + width * i;
    for (std::size_t k = 0; k < width; ++k) row[k] = adds ? row[k] + values[k] : values[k];
  }
};

void clear_row(std::span<float> rows, std::size_t i, std::size_t width) {
  if (!rows.empty()) std::fill_n(rows.data() + width * i, width, 0.0f);
}

void clear(const Convexes& convexes, const ConvexGradients& out, std::size_t i) {
  clear_row(out.view_sharpness, i, 1);
  clear_row(out.view_sharpness_abs, i, 1);
  if (out.mode == GradientMode::accumulate) return;
  clear_row(out.points, i, 3 * static_cast<std::size_t>(convexes.points_per_convex));
  clear_row(out.smoothness, i, 1);
  clear_row(out.sharpness, i, 1);
  clear_row(out.opacities, i, 1);
  clear_row(out.sh_dc, i, 3);
  clear_row(out.sh_rest, i, 3 * static_cast<std::size_t>(convexes.sh_rest_rows));
  clear_row(out.colors, i, 3);
}

/// Gradient through spherical harmonics: writes the coefficients', returns the centre's.
Vec3<float> sh_backward(const ConvexFrame& frame, const Convexes& convexes, const ConvexGradients& out,
                        const RowWriter& write, std::size_t i, const float (&g_color)[3]) {
  const ConvexRecord& record = frame.records[i];
  // No gradient where the colour was clamped at zero.
  const float g[3] = {record.red > 0.0f ? g_color[0] : 0.0f, record.green > 0.0f ? g_color[1] : 0.0f,
                      record.blue > 0.0f ? g_color[2] : 0.0f};
  const int used = sh_coefficients(convexes.sh_degree);
  const Ray ray = ray_to(convexes, i, frame);
  float basis[kMaxShCoefficients];
  math::sh_basis(convexes.sh_degree, ray.direction, basis);
  const float dc[3] = {basis[0] * g[0], basis[0] * g[1], basis[0] * g[2]};
  write(out.sh_dc, i, dc, 3);
  const std::size_t width = 3 * static_cast<std::size_t>(convexes.sh_rest_rows);
  const float* const rest = convexes.sh_rest.data() + width * i;
  float weights[kMaxShCoefficients] = {};
  for (int k = 1; k < used; ++k) {
    for (int c = 0; c < 3; ++c) weights[k] += rest[3 * (k - 1) + c] * g[c];
  }
  if (!out.sh_rest.empty()) {
    float* const row = out.sh_rest.data() + width * i;
    for (std::size_t k = 0; k < width; ++k) {
      const float value = k < 3 * static_cast<std::size_t>(used - 1) ? basis[k / 3 + 1] * g[k % 3] : 0.0f;
      row[k] = write.adds ? row[k] + value : value;
    }
  }
  if (used == 1) return {0.0f, 0.0f, 0.0f};
  return math::through_normalise(ray.direction, ray.inverse_length,
                                 math::sh_basis_gradient(convexes.sh_degree, ray.direction, weights));
}

void backward_one(const ConvexFrame& frame, const Convexes& convexes, const ConvexGradients& out, std::size_t i) {
  // Sums over the lists' entries, in their order.
  constexpr std::size_t kWidth = sizeof(ConvexMoments) / sizeof(float);
  alignas(64) float total[kWidth] = {};
  const std::size_t slot = frame.first_slot(i);
  for (std::uint32_t t = 0; t < frame.listings[i].tiles; ++t) {
    const auto* const entry = reinterpret_cast<const float*>(&frame.entry_moments[slot + t]);
    for (std::size_t k = 0; k < kWidth; ++k) total[k] += entry[k];
  }
  const auto& moments = *reinterpret_cast<const ConvexMoments*>(total);

  const ConvexRecord& record = frame.records[i];
  const ConvexOptions& options = frame.options;
  const int count = convexes.points_per_convex;
  ProjectedConvex p = project_convex(frame.projection, points_of(convexes, i), count, options.near_plane);
  p.edges = static_cast<int>(record.edges);  // the hull that was drawn, whatever rounding says now
  std::copy_n(record.hull, p.edges, p.hull);
  ConvexSums sums;
  sums.opacity = moments.s;
  sums.steepness = kLn2 * moments.steepness;
  for (int k = 0; k < p.edges; ++k) {
    for (int m = 0; m < 3; ++m) sums.edge[k][m] = record.steepness * moments.edge[k][m];
  }
  ConvexGeometryGradient g =
      project_convex_backward(frame.projection, p, count, convexes.smoothness[i], convexes.sharpness[i],
                              options.pixel_size * options.pixel_size, sums);

  const RowWriter write{out.mode == GradientMode::accumulate};
  const float g_color[3] = {moments.red, moments.green, moments.blue};
  if (!convexes.colors.empty()) {
    write(out.colors, i, g_color, 3);
  } else {
    const Vec3<float> of_centre = sh_backward(frame, convexes, out, write, i, g_color);
    const float share = 1.0f / static_cast<float>(count);
    for (int k = 0; k < count; ++k) {
      g.points[k][0] += share * of_centre.x;
      g.points[k][1] += share * of_centre.y;
      g.points[k][2] += share * of_centre.z;
    }
  }
  const float of_opacity = sums.opacity / record.opacity;  // dα/do = α/o
  write(out.points, i, &g.points[0][0], 3 * static_cast<std::size_t>(count));
  write(out.smoothness, i, &g.smoothness, 1);
  write(out.sharpness, i, &g.sharpness, 1);
  write(out.opacities, i, &of_opacity, 1);
  const float absolute = frame.depths[i] * kLn2 * moments.steepness_abs;
  const RowWriter set{false};
  set(out.view_sharpness, i, &g.sharpness, 1);
  set(out.view_sharpness_abs, i, &absolute, 1);
}

}  // namespace

void project_convexes(ConvexFrame& frame, const Convexes& convexes, Threads& threads) {
  const std::size_t n = convexes.count;
  frame.records.ensure(n);
  frame.depths.ensure(n);
  frame.visible.ensure(n);
  frame.listings.ensure(n);
  if (frame.listed_tiles.size() < frame.pieces()) frame.listed_tiles.resize(frame.pieces());
  threads.for_range(n, kProjectGrain,
                    [&](std::size_t begin, std::size_t end) { project_range(frame, convexes, begin, end); });
}

void project_convexes_backward(const ConvexFrame& frame, const Convexes& convexes, const ConvexGradients& gradients,
                               Threads& threads) {
  threads.for_range(frame.primitives, kProjectGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      frame.visible[i] != 0 ? backward_one(frame, convexes, gradients, i) : clear(convexes, gradients, i);
    }
  });
}

}  // namespace splatboost
