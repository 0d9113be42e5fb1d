// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstring>

#include "projection/frame.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "projection/project_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "projection/primitive_blocks-inl.h"
#include "projection/project_math.h"
#include "projection/tile_math.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

/// Covariances of a block. The other members are set only if covariances are computed from scales and rotations.
struct Shape {
  Symmetric3<Float> covariance;
  Vec3<Float> scale;
  Quaternion<Float> unit;
  Float inverse_length;  ///< 1 / length of the stored quaternion; 1 without
  Matrix3<Float> rotation;
};

void shape_at(const Gaussians& gaussians, std::size_t i, std::size_t count, Shape& shape) {
  if (!gaussians.covariances.empty()) {
    alignas(64) float c[6 * kMaxLanes];
    rows_to_columns(gaussians.covariances.data() + 6 * i, 6, count, 6, c);
    const std::size_t n = lanes();
    shape.covariance = {load(c), load(c + n), load(c + 2 * n), load(c + 3 * n), load(c + 4 * n), load(c + 5 * n)};
    shape.inverse_length = Float(1.0f);
    return;
  }
  shape.scale = vec3_at(gaussians.scales, i, count);
  Float q[4];
  load_rows(gaussians.rotations.data() + 4 * i, count, q);
  const Quaternion<Float> quaternion{q[0], q[1], q[2], q[3]};
  shape.inverse_length = Float(1.0f) / sqrt_of(dot(quaternion, quaternion));
  shape.unit = shape.inverse_length * quaternion;
  shape.rotation = rotation_of(shape.unit);
  shape.covariance = covariance_of(shape.scale, shape.rotation);
}

void project_block(Frame& frame, const Gaussians& gaussians, std::size_t i, std::size_t count,
                   std::vector<std::uint32_t>& listed) {
  const RasterOptions& options = frame.options;
  const Float zero(0.0f);
  const Vec3<Float> mean = vec3_at(gaussians.means, i, count);
  Shape shape;
  shape_at(gaussians, i, count, shape);
  const Projection<Float> p = project_gaussian(frame.projection, mean, shape.covariance, options.low_pass,
                                               options.compensate_opacity, options.near_plane);
  Float opacity[1];
  load_rows(gaussians.opacities.data() + i, count, opacity);
  const Float drawn = opacity[0] * p.compensation;
  Bool visible = p.valid & is_normalisable(shape.inverse_length);
  visible = visible & (drawn >= zero) & (drawn < Float(3e38f));  // false if the opacity is not finite
  const Float log2_opacity = log2_of(max_of(drawn, Float(1e-30f)));

  const bool square = options.box == BoxPolicy::square;
  const Float radius = square_radius(p.covariance);
  TileRange<Float> x, y;
  Ellipse<Float> ellipse{};
  if (square) {
    x = square_tiles(p.mean.x, radius, frame.tiles_x);
    y = square_tiles(p.mean.y, radius, frame.tiles_y);
  } else {
    const Float t = Float(options.beta) * reach_of(log2_opacity);
    visible = visible & (t > zero);
    ellipse = make_ellipse(p.mean, p.covariance, p.conic, t);
    x = ellipse_tile_columns(ellipse, frame.tiles_x);
    y = ellipse_tile_rows(ellipse, frame.tiles_y);
  }
  visible = visible & (x.begin < x.end) & (y.begin < y.end);

  alignas(64) std::int32_t radii[kMaxLanes];
  store_whole(select(visible, min_of(radius, Float(1e9f)), zero), radii);
  const Float top = select(visible, y.begin, zero), rows = select(visible, y.end - y.begin, zero);
  if (square) {
    list_tiles(frame, i, count, top, rows, listed, [&](Float) HWY_ATTR { return x; });
  } else {
    list_tiles(frame, i, count, top, rows, listed,
               [&](Float row) HWY_ATTR { return ellipse_tiles_in_row(ellipse, row, frame.tiles_x); });
  }
  bool any = false;
  for (std::size_t lane = 0; lane < count; ++lane) {
    const bool seen = frame.listings[i + lane].tiles > 0;
    frame.visible[i + lane] = seen ? 1 : 0;
    frame.radii[i + lane] = seen ? radii[lane] : 0;
    any |= seen;
  }
  if (!any) return;

  const Vec3<Float> color = frame.color ? color_at(gaussians, i, count, ray_to(mean, frame.projection).direction)
                                        : Vec3<Float>{zero, zero, zero};
  const Float per_half(-1.0f / kTwoLn2);  // from Mahalanobis² to the base-2 logarithm of exp(-½·Mahalanobis²)
  const Float fields[] = {p.mean.x,
                          p.mean.y,
                          per_half * p.conic.xx,
                          Float(2.0f) * per_half * p.conic.xy,
                          per_half * p.conic.yy,
                          log2_opacity,
                          -p.conic.xy / p.conic.xx,
                          color.x,
                          color.y,
                          color.z,
                          p.view.z,
                          zero};
  constexpr std::size_t kFields = sizeof fields / sizeof fields[0];
  alignas(64) float columns[kFields * kMaxLanes];
  for (std::size_t f = 0; f < kFields; ++f) store(fields[f], columns + f * lanes());
  columns_to_rows(columns, kFields, count, false, &frame.records[i].mean_x, sizeof(BlendRecord) / sizeof(float));
  for (std::size_t lane = 0; lane < count; ++lane) frame.depths[i + lane] = frame.records[i + lane].depth;

  const auto features = static_cast<std::size_t>(frame.features),
             extra = static_cast<std::size_t>(frame.extra_channels());
  for (std::size_t lane = 0; extra > 0 && lane < count; ++lane) {
    float* channels = frame.channels.data() + (i + lane) * extra;
    std::copy_n(gaussians.features.data() + (i + lane) * features, features, channels);
    if (frame.inverse_depth) channels[features] = 1.0f / frame.depths[i + lane];
  }
}

void project_range(Frame& frame, const Gaussians& gaussians, std::size_t begin, std::size_t end) {
  std::vector<std::uint32_t>& listed = frame.listed_tiles[begin / kProjectGrain];
  listed.clear();
  for (std::size_t i = begin; i < end; i += lanes()) {
    project_block(frame, gaussians, i, std::min(lanes(), end - i), listed);
  }
}

/// Sums the moments of each primitive of a block over its entries, in the order of slots. @param columns [12, lanes]
void gather(const Frame& frame, std::size_t i, std::size_t count, float* columns) {
  constexpr std::size_t kWidth = sizeof(EntryMoments) / sizeof(float);
  const Lanes d;
  alignas(64) float rows[kMaxLanes * kWidth];
  for (std::size_t lane = 0; lane < count; ++lane) {
    Float sum[kWidth / lanes()];
    for (Float& s : sum) s = Float(0.0f);
    const std::size_t slot = frame.first_slot(i + lane);
    for (std::uint32_t k = 0; k < frame.listings[i + lane].tiles; ++k) {
      const auto* entry = reinterpret_cast<const float*>(&frame.entry_moments[slot + k]);
      for (std::size_t v = 0; v < kWidth / lanes(); ++v) sum[v] += Float(hn::Load(d, entry + v * lanes()));
    }
    for (std::size_t k = 0; k < kWidth / lanes(); ++k) hn::Store(sum[k].v, d, rows + lane * kWidth + k * lanes());
  }
  rows_to_columns(rows, kWidth, count, 12, columns);
}

/// Writes or adds zero gradients of colours.
void clear_colors(const GaussianGradients& g, const Gaussians& gaussians, std::size_t i, std::size_t count) {
  if (g.mode == GradientMode::overwrite) {
    clear_rows(g.sh_dc, 3, i, count);
    clear_rows(g.sh_rest, 3 * static_cast<std::size_t>(gaussians.sh_rest_rows), i, count);
    clear_rows(g.colors, 3, i, count);
  }
  clear_rows(g.sh_factors, kShFactors, i, count);
}

void clear_block(const GaussianGradients& g, const Gaussians& gaussians, std::size_t i, std::size_t count) {
  if (g.mode == GradientMode::overwrite) {
    clear_rows(g.means, 3, i, count);
    clear_rows(g.scales, 3, i, count);
    clear_rows(g.rotations, 4, i, count);
    clear_rows(g.covariances, 6, i, count);
    clear_rows(g.opacities, 1, i, count);
    clear_rows(g.features, static_cast<std::size_t>(gaussians.features_per_gaussian), i, count);
  }
  clear_colors(g, gaussians, i, count);
  clear_rows(g.screen_means, 2, i, count);
  clear_rows(g.screen_means_abs, 2, i, count);
}

void feature_gradients(const Frame& frame, const Gaussians& gaussians, const GaussianGradients& out, std::size_t i) {
  float sum[kMaxFeatures] = {};
  const auto drawn = static_cast<std::size_t>(frame.features);  // 0 if the view was rendered without features
  const std::size_t slot = frame.first_slot(i);
  for (std::size_t k = 0; drawn > 0 && k < frame.listings[i].tiles; ++k) {
    const float* entry = frame.entry_channel_gradients.data() + drawn * (slot + k);
    for (std::size_t f = 0; f < drawn; ++f) sum[f] += entry[f];
  }
  const auto width = static_cast<std::size_t>(gaussians.features_per_gaussian);
  float* row = out.features.data() + width * i;
  for (std::size_t f = 0; f < width; ++f) row[f] = out.mode == GradientMode::overwrite ? sum[f] : row[f] + sum[f];
}

void backward_block(const Frame& frame, const Gaussians& gaussians, const GaussianGradients& out, std::size_t i,
                    std::size_t count) {
  alignas(64) float seen[kMaxLanes] = {};
  bool any = false;
  for (std::size_t lane = 0; lane < count; ++lane) {
    seen[lane] = frame.visible[i + lane] != 0 ? 1.0f : 0.0f;
    any |= frame.visible[i + lane] != 0;
  }
  if (!any) {
    clear_block(out, gaussians, i, count);
    return;
  }
  const Float zero(0.0f), half(0.5f);
  const BlockWriter writer{i, count, out.mode == GradientMode::accumulate, load(seen) > zero};
  const ProjectionCamera& camera = frame.projection;
  const RasterOptions& options = frame.options;

  alignas(64) float moments[12 * kMaxLanes];
  gather(frame, i, count, moments);
  const auto moment = [&](std::size_t k) HWY_ATTR { return load(moments + k * lanes()); };
  const Float s = moment(0), s_x = moment(1), s_y = moment(2), s_xx = moment(3), s_xy = moment(4), s_yy = moment(5);
  const Vec3<Float> g_color{moment(6), moment(7), moment(8)};
  const Float abs_x = moment(9), abs_y = moment(10), g_inverse_depth = moment(11);

  const Vec3<Float> mean = vec3_at(gaussians.means, i, count);
  Shape shape;
  shape_at(gaussians, i, count, shape);
  const Projection<Float> p = project_gaussian(camera, mean, shape.covariance, options.low_pass,
                                               options.compensate_opacity, options.near_plane);
  Float opacity[1];
  load_rows(gaussians.opacities.data() + i, count, opacity);

  ProjectionGradient<Float> up;
  up.mean = {p.conic.xx * s_x + p.conic.xy * s_y, p.conic.xy * s_x + p.conic.yy * s_y};
  up.conic = {-(half * s_xx), -s_xy, -(half * s_yy)};
  // dα/dσ = α/σ, and σ = opacity · compensation
  const Float drawn = opacity[0] * p.compensation;
  const Float g_drawn = select(drawn > zero, s / drawn, zero);
  up.compensation = g_drawn * opacity[0];
  up.view_z = -(g_inverse_depth / (p.view.z * p.view.z));
  GaussianGeometryGradient<Float> geometry =
      project_gaussian_backward(camera, p, shape.covariance, options.low_pass, options.compensate_opacity, up);

  if (!frame.color) {
    clear_colors(out, gaussians, i, count);
  } else if (!gaussians.colors.empty()) {
    writer.write(out.colors, {g_color.x, g_color.y, g_color.z});
  } else {
    // No gradient where the colour was clamped at zero.
    alignas(64) float drawn_colors[3 * kMaxLanes];
    rows_to_columns(&frame.records[i].red, sizeof(BlendRecord) / sizeof(float), count, 3, drawn_colors);
    const auto unclamped = [&](std::size_t c, Float g)
                               HWY_ATTR { return select(load(drawn_colors + c * lanes()) > zero, g, zero); };
    const Vec3<Float> g{unclamped(0, g_color.x), unclamped(1, g_color.y), unclamped(2, g_color.z)};
    geometry.mean = geometry.mean + sh_backward(gaussians, out, writer, ray_to(mean, camera), g);
  }
  writer.write(out.means, {geometry.mean.x, geometry.mean.y, geometry.mean.z});
  writer.write(out.opacities, {g_drawn * p.compensation});

  if (!gaussians.covariances.empty()) {
    const Symmetric3<Float>& c = geometry.covariance;
    const Float two(2.0f);  // each off-diagonal element occurs twice in the matrix
    const Float entries[6] = {c.xx, two * c.xy, two * c.xz, c.yy, two * c.yz, c.zz};
    alignas(64) float columns[6 * kMaxLanes];
    for (std::size_t k = 0; k < 6; ++k) store(select(writer.visible, entries[k], zero), columns + k * lanes());
    if (!out.covariances.empty()) {
      columns_to_rows(columns, 6, count, writer.adds, out.covariances.data() + 6 * i, 6);
    }
  } else {
    Vec3<Float> g_scale;
    Quaternion<Float> g_rotation;
    covariance_backward(shape.scale, shape.unit, shape.inverse_length, shape.rotation, geometry.covariance, g_scale,
                        g_rotation);
    writer.write(out.scales, {g_scale.x, g_scale.y, g_scale.z});
    writer.write(out.rotations, {g_rotation.w, g_rotation.x, g_rotation.y, g_rotation.z});
  }
  if (!out.features.empty()) {
    for (std::size_t lane = 0; lane < count; ++lane) feature_gradients(frame, gaussians, out, i + lane);
  }
  const Float from_log2(0.5f * kTwoLn2);  // abs_x and abs_y are derivatives of log2 α
  writer.write(out.screen_means, {up.mean.x, up.mean.y}, false);
  writer.write(out.screen_means_abs, {from_log2 * abs_x, from_log2 * abs_y}, false);
}

void backward_range(const Frame& frame, const Gaussians& gaussians, const GaussianGradients& gradients,
                    std::size_t begin, std::size_t end) {
  for (std::size_t i = begin; i < end; i += lanes()) {
    backward_block(frame, gaussians, gradients, i, std::min(lanes(), end - i));
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost {
namespace {
HWY_EXPORT(project_range);
HWY_EXPORT(backward_range);
}  // namespace

void project(Frame& frame, const Gaussians& gaussians, const Threads& threads) {
  const std::size_t n = gaussians.count;
  frame.records.ensure(n);
  frame.depths.ensure(n);
  frame.visible.ensure(n);
  frame.radii.ensure(n);
  frame.channels.ensure(n * static_cast<std::size_t>(frame.extra_channels()));
  frame.listings.ensure(n);
  if (frame.listed_tiles.size() < frame.pieces()) frame.listed_tiles.resize(frame.pieces());
  threads.for_range(n, kProjectGrain, [&](std::size_t begin, std::size_t end) {
    HWY_DYNAMIC_DISPATCH(project_range)(frame, gaussians, begin, end);
  });
}

void project_backward(const Frame& frame, const Gaussians& gaussians, const GaussianGradients& gradients,
                      const Threads& threads) {
  threads.for_range(frame.primitives, kProjectGrain, [&](std::size_t begin, std::size_t end) {
    HWY_DYNAMIC_DISPATCH(backward_range)(frame, gaussians, gradients, begin, end);
  });
}

}  // namespace splatboost
#endif  // HWY_ONCE
