// SPDX-License-Identifier: Apache-2.0
#include "convexes/cuda_convex_frame.h"
#include "device/device_view.h"
#include "device/launch.h"

namespace splatboost::cuda {
namespace {

struct ConvexViews {
  DeviceView<const float> points, smoothness, sharpness, opacities, sh_dc, sh_rest, colors;
  int points_per_convex, sh_rest_rows, sh_degree;

  explicit ConvexViews(const Convexes& c)
      : points(c.points),
        smoothness(c.smoothness),
        sharpness(c.sharpness),
        opacities(c.opacities),
        sh_dc(c.sh_dc),
        sh_rest(c.sh_rest),
        colors(c.colors),
        points_per_convex(c.points_per_convex),
        sh_rest_rows(c.sh_rest_rows),
        sh_degree(c.sh_degree) {}

  __device__ ConvexRows rows(std::size_t i) const {
    const auto row = [i](const DeviceView<const float>& values, int width) {
      return values.empty() ? nullptr : &values[static_cast<std::size_t>(width) * i];
    };
    return {row(points, 3 * points_per_convex),
            points_per_convex,
            smoothness[i],
            sharpness[i],
            opacities[i],
            row(colors, 3),
            row(sh_dc, 3),
            row(sh_rest, 3 * sh_rest_rows),
            sh_degree};
  }
};

__global__ void __launch_bounds__(kBlockThreads)
    project_convexes_kernel(ConvexViews convexes, ConvexViewpoint view, DeviceView<ConvexRecord> records,
                            DeviceView<ConvexTiles> tiles_of, DeviceView<std::uint8_t> visible,
                            DeviceView<std::uint32_t> counts) {
  const std::size_t i = element_index();
  if (i >= counts.size()) return;
  std::uint32_t count = 0;
  if (i < records.size()) {
    ConvexRecord record{};
    ConvexTiles tiles{};
    if (make_record(convexes.rows(i), view, record, tiles)) {
      for_tile_rows(tiles, view, [&](int, int from, int to) {
        if (to > from) count += static_cast<std::uint32_t>(to - from);
      });
      records[i] = record;
      tiles_of[i] = tiles;
    }
    visible[i] = count > 0 ? 1 : 0;
  }
  counts[i] = count;  // one more than there are convexes, for the scan
}

struct GradientViews {
  bool adds;
  DeviceView<float> points, smoothness, sharpness, opacities, sh_dc, sh_rest, colors, view_sharpness,
      view_sharpness_abs, screen_points;

  explicit GradientViews(const ConvexGradients& g)
      : adds(g.mode == GradientMode::accumulate),
        points(g.points),
        smoothness(g.smoothness),
        sharpness(g.sharpness),
        opacities(g.opacities),
        sh_dc(g.sh_dc),
        sh_rest(g.sh_rest),
        colors(g.colors),
        view_sharpness(g.view_sharpness),
        view_sharpness_abs(g.view_sharpness_abs),
        screen_points(g.screen_points) {}

  __device__ static void put(const DeviceView<float>& rows, bool add, std::size_t at, float value) {
    if (!rows.empty()) rows[at] = add ? rows[at] + value : value;
  }
};

/// @param visible 0: all gradients are zero
__global__ void __launch_bounds__(kBlockThreads)
    project_convexes_backward_kernel(ConvexViews convexes, ConvexViewpoint view, DeviceView<const ConvexRecord> records,
                                     DeviceView<const std::uint8_t> visible, DeviceView<const float> moments,
                                     GradientViews out) {
  const std::size_t i = element_index();
  if (i >= records.size()) return;
  ConvexRowGradients g{};
  if (visible[i] != 0) {
    ConvexMoments total;
    auto* const sums = reinterpret_cast<float*>(&total);
    for (int k = 0; k < kConvexMomentColumns; ++k) sums[k] = moments[i * kConvexMomentColumns + k];
    find_gradients(convexes.rows(i), view, records[i], total, g);
  }
  using Views = GradientViews;
  for (int k = 0; k < 3 * convexes.points_per_convex; ++k) {
    const std::size_t at = i * static_cast<std::size_t>(3 * convexes.points_per_convex) + k;
    Views::put(out.points, out.adds, at, g.geometry.points[k / 3][k % 3]);
  }
  Views::put(out.smoothness, out.adds, i, g.geometry.smoothness);
  Views::put(out.sharpness, out.adds, i, g.geometry.sharpness);
  Views::put(out.opacities, out.adds, i, g.opacity);
  Views::put(out.view_sharpness, false, i, g.geometry.sharpness);
  Views::put(out.view_sharpness_abs, false, i, g.view_sharpness_abs);
  for (int c = 0; c < 3; ++c) {
    Views::put(out.screen_points, false, 3 * i + c, g.geometry.screen[c]);
    Views::put(out.colors, out.adds, 3 * i + c, g.color[c]);
    Views::put(out.sh_dc, out.adds, 3 * i + c, g.sh_basis[0] * g.color[c]);
  }
  const int used = sh_coefficients(convexes.sh_degree) - 1;
  for (int k = 0; k < 3 * convexes.sh_rest_rows; ++k) {
    const float value = k < 3 * used ? g.sh_basis[k / 3 + 1] * g.color[k % 3] : 0.0f;
    Views::put(out.sh_rest, out.adds, i * static_cast<std::size_t>(3 * convexes.sh_rest_rows) + k, value);
  }
}

}  // namespace

void project_convexes(CudaConvexFrame& frame, const Convexes& convexes, CudaStream& stream) {
  frame.records.ensure(frame.convexes);
  frame.tiles_of.ensure(frame.convexes);
  frame.visible.ensure(frame.convexes);
  frame.entry_offsets.ensure(frame.convexes + 1);
  launch_each(stream, "project_convexes", project_convexes_kernel, frame.convexes + 1, ConvexViews(convexes),
              frame.view, frame.records.span(), frame.tiles_of.span(), frame.visible.span(),
              frame.entry_offsets.span());
}

void project_convexes_backward(const CudaConvexFrame& frame, const Convexes& convexes, const ConvexGradients& gradients,
                               CudaStream& stream) {
  launch_each(stream, "project_convexes_backward", project_convexes_backward_kernel, frame.convexes,
              ConvexViews(convexes), frame.view, frame.records.span(), frame.visible.span(), frame.moments.span(),
              GradientViews(gradients));
}

}  // namespace splatboost::cuda
