// SPDX-License-Identifier: Apache-2.0
#include "device/device_view.h"
#include "device/launch.h"
#include "projection/cuda_frame.h"
#include "projection/project_math.h"
#include "projection/sh_math.h"
#include "projection/tile_math.h"

namespace splatboost::cuda {
namespace {

/// Gaussians as kernel parameters.
struct GaussianViews {
  DeviceView<const float> means, scales, rotations, covariances, opacities, sh_dc, sh_rest, colors, features;
  int sh_rest_rows, sh_degree, features_per_gaussian;

  explicit GaussianViews(const Gaussians& g)
      : means(g.means),
        scales(g.scales),
        rotations(g.rotations),
        covariances(g.covariances),
        opacities(g.opacities),
        sh_dc(g.sh_dc),
        sh_rest(g.sh_rest),
        colors(g.colors),
        features(g.features),
        sh_rest_rows(g.sh_rest_rows),
        sh_degree(g.sh_degree),
        features_per_gaussian(g.features_per_gaussian) {}
};

struct ProjectOptions {
  ProjectionCamera camera;
  float low_pass, near_plane, beta;
  bool compensate, square;
  int tiles_x, tiles_y;

  explicit ProjectOptions(const CudaFrame& frame)
      : camera(frame.projection),
        low_pass(frame.options.low_pass),
        near_plane(frame.options.near_plane),
        beta(frame.options.beta),
        compensate(frame.options.compensate_opacity),
        square(frame.options.box == BoxPolicy::square),
        tiles_x(frame.tiles_x),
        tiles_y(frame.tiles_y) {}
};

__device__ Vec3<float> vec3_at(const DeviceView<const float>& rows, std::size_t i) {
  return {rows[3 * i], rows[3 * i + 1], rows[3 * i + 2]};
}

/// Covariance of a Gaussian. The other members are set only if it is computed from scale and rotation.
struct Shape {
  Symmetric3<float> covariance;
  Vec3<float> scale;
  Quaternion<float> unit;
  float inverse_length;  ///< 1 / length of the stored quaternion; 1 without
  Matrix3<float> rotation;
};

__device__ Shape shape_at(const GaussianViews& gaussians, std::size_t i) {
  Shape shape{};
  if (!gaussians.covariances.empty()) {
    const auto& c = gaussians.covariances;
    shape.covariance = {c[6 * i], c[6 * i + 1], c[6 * i + 2], c[6 * i + 3], c[6 * i + 4], c[6 * i + 5]};
    shape.inverse_length = 1.0f;
    return shape;
  }
  shape.scale = vec3_at(gaussians.scales, i);
  const auto& q = gaussians.rotations;
  const Quaternion<float> quaternion{q[4 * i], q[4 * i + 1], q[4 * i + 2], q[4 * i + 3]};
  shape.inverse_length = 1.0f / sqrtf(dot(quaternion, quaternion));
  shape.unit = shape.inverse_length * quaternion;
  shape.rotation = rotation_of(shape.unit);
  shape.covariance = covariance_of(shape.scale, shape.rotation);
  return shape;
}

/// View direction from the camera to a Gaussian.
struct Ray {
  Vec3<float> direction;
  float inverse_length;
};

__device__ Ray ray_to(Vec3<float> mean, const ProjectionCamera& camera) {
  const Vec3<float> ray = mean - widen<float>(camera.centre);
  const float inverse_length = 1.0f / sqrtf(dot(ray, ray));
  return {inverse_length * ray, inverse_length};
}

__device__ Vec3<float> color_at(const GaussianViews& gaussians, std::size_t i, Vec3<float> direction) {
  if (!gaussians.colors.empty()) return vec3_at(gaussians.colors, i);
  float basis[kMaxShCoefficients];
  sh_basis(gaussians.sh_degree, direction, basis);
  Vec3<float> color = Vec3<float>{0.5f, 0.5f, 0.5f} + basis[0] * vec3_at(gaussians.sh_dc, i);
  const std::size_t row = i * static_cast<std::size_t>(gaussians.sh_rest_rows);
#pragma unroll
  for (int k = 1; k < kMaxShCoefficients; ++k) {
    if (k >= sh_coefficients(gaussians.sh_degree)) break;
    color = color + basis[k] * vec3_at(gaussians.sh_rest, row + static_cast<std::size_t>(k - 1));
  }
  return {max_of(color.x, 0.0f), max_of(color.y, 0.0f), max_of(color.z, 0.0f)};
}

/// Outputs of projection.
struct ProjectResults {
  DeviceView<SplatRecord> records;
  DeviceView<SplatEllipse> ellipses;
  DeviceView<TileBox> boxes;
  DeviceView<std::uint32_t> tile_counts;
  DeviceView<std::uint8_t> visible;
  DeviceView<std::uint32_t> places;  ///< one more than there are Gaussians, for the scan
  DeviceView<std::int32_t> radii;
  DeviceView<float> channels;
  bool color;
  int features;
  bool inverse_depth;
};

__device__ std::uint16_t whole(float tile) { return static_cast<std::uint16_t>(tile); }

__global__ void __launch_bounds__(kBlockThreads)
    project_kernel(GaussianViews gaussians, ProjectOptions options, ProjectResults out) {
  const std::size_t i = element_index();
  if (i >= out.visible.size()) {
    if (i < out.places.size()) out.places[i] = 0;
    return;
  }
  const Vec3<float> mean = vec3_at(gaussians.means, i);
  const Shape shape = shape_at(gaussians, i);
  const Projection<float> p = project_gaussian(options.camera, mean, shape.covariance, options.low_pass,
                                               options.compensate, options.near_plane);
  const float drawn = gaussians.opacities[i] * p.compensation;
  bool seen = p.valid && is_normalisable(shape.inverse_length);
  seen = seen && drawn >= 0.0f && drawn < 3e38f;  // false if the opacity is not finite
  const float log2_opacity = log2_of(max_of(drawn, 1e-30f));
  const float radius = square_radius(p.covariance);

  std::uint32_t tiles = 0;
  if (seen) {
    TileRange<float> x, y;
    Ellipse<float> ellipse{};
    if (options.square) {
      x = square_tiles(p.mean.x, radius, options.tiles_x);
      y = square_tiles(p.mean.y, radius, options.tiles_y);
    } else {
      const float t = options.beta * reach_of(log2_opacity);
      seen = t > 0.0f;
      ellipse = make_ellipse(p.mean, p.covariance, p.conic, t);
      x = ellipse_tile_columns(ellipse, options.tiles_x);
      y = ellipse_tile_rows(ellipse, options.tiles_y);
    }
    seen = seen && x.begin < x.end && y.begin < y.end;
    if (seen && options.square) {
      tiles = static_cast<std::uint32_t>((x.end - x.begin) * (y.end - y.begin));
    } else if (seen) {
      for (float row = y.begin; row < y.end; row += 1.0f) {
        const TileRange<float> in_row = ellipse_tiles_in_row(ellipse, row, options.tiles_x);
        tiles += static_cast<std::uint32_t>(max_of(in_row.end - in_row.begin, 0.0f));
      }
      out.ellipses[i] = {ellipse.mean.x,   ellipse.mean.y, ellipse.conic.xx,   ellipse.conic.xy,
                         ellipse.conic.yy, ellipse.t,      ellipse.half_width, ellipse.half_height};
    }
    if (seen) out.boxes[i] = {whole(x.begin), whole(x.end), whole(y.begin), whole(y.end)};
  }
  seen = tiles > 0;
  out.tile_counts[i] = tiles;
  out.visible[i] = seen ? 1 : 0;
  out.places[i] = seen ? 1 : 0;
  out.radii[i] = seen ? static_cast<std::int32_t>(min_of(radius, 1e9f)) : 0;
  if (!seen) return;

  const Vec3<float> color = out.color ? color_at(gaussians, i, ray_to(mean, options.camera).direction) : Vec3<float>{};
  const float per_half = -1.0f / kTwoLn2;  // from Mahalanobis² to the base-2 logarithm of exp(-½·Mahalanobis²)
  SplatRecord record;
  record.mean_x = p.mean.x;
  record.mean_y = p.mean.y;
  record.log2_opacity = log2_opacity;
  record.depth = p.view.z;
  record.quadratic_xx = per_half * p.conic.xx;
  record.quadratic_xy = 2.0f * per_half * p.conic.xy;
  record.quadratic_yy = per_half * p.conic.yy;
  record.gaussian = static_cast<std::uint32_t>(i);
  record.red = color.x;
  record.green = color.y;
  record.blue = color.z;
  record.unused = 0.0f;
  out.records[i] = record;

  const std::size_t features = static_cast<std::size_t>(out.features);
  const std::size_t channels = i * (features + (out.inverse_depth ? 1 : 0));
  for (std::size_t f = 0; f < features; ++f) out.channels[channels + f] = gaussians.features[i * features + f];
  if (out.inverse_depth) out.channels[channels + features] = 1.0f / p.view.z;
}

/// Gradients as kernel parameters.
struct GradientViews {
  DeviceView<float> means, scales, rotations, covariances, opacities, sh_dc, sh_rest, colors, features, screen_means,
      screen_means_abs;
  bool adds;

  explicit GradientViews(const GaussianGradients& g)
      : means(g.means),
        scales(g.scales),
        rotations(g.rotations),
        covariances(g.covariances),
        opacities(g.opacities),
        sh_dc(g.sh_dc),
        sh_rest(g.sh_rest),
        colors(g.colors),
        features(g.features),
        screen_means(g.screen_means),
        screen_means_abs(g.screen_means_abs),
        adds(g.mode == GradientMode::accumulate) {}

  /// Writes a value at index `at`, or adds it to the value there.
  __device__ void put(const DeviceView<float>& rows, std::size_t at, float value) const {
    if (rows.empty()) return;
    rows[at] = adds ? rows[at] + value : value;
  }
  __device__ void put(const DeviceView<float>& rows, std::size_t i, Vec3<float> v) const {
    put(rows, 3 * i, v.x);
    put(rows, 3 * i + 1, v.y);
    put(rows, 3 * i + 2, v.z);
  }
  __device__ static void clear(const DeviceView<float>& rows, std::size_t i, std::size_t width) {
    if (rows.empty()) return;
    for (std::size_t k = 0; k < width; ++k) rows[i * width + k] = 0.0f;
  }
  /// Clears the gradients of a Gaussian that was not drawn; accumulated ones stay.
  __device__ void clear_row(std::size_t i, const GaussianViews& gaussians) const {
    clear(screen_means, i, 2);
    clear(screen_means_abs, i, 2);
    if (adds) return;
    clear(means, i, 3);
    clear(scales, i, 3);
    clear(rotations, i, 4);
    clear(covariances, i, 6);
    clear(opacities, i, 1);
    clear(features, i, static_cast<std::size_t>(gaussians.features_per_gaussian));
    clear_color(i, gaussians);
  }
  /// Writes or adds zero gradients of a Gaussian's colour.
  __device__ void clear_color(std::size_t i, const GaussianViews& gaussians) const {
    if (adds) return;
    clear(sh_dc, i, 3);
    clear(sh_rest, i, 3 * static_cast<std::size_t>(gaussians.sh_rest_rows));
    clear(colors, i, 3);
  }
};

/// Gradient through spherical harmonics: writes that of the coefficients, returns that of the mean.
__device__ Vec3<float> sh_backward(const GaussianViews& gaussians, const GradientViews& out, std::size_t i,
                                   const Ray& ray, Vec3<float> g) {
  const int used = sh_coefficients(gaussians.sh_degree) - 1;
  float basis[kMaxShCoefficients];
  sh_basis(gaussians.sh_degree, ray.direction, basis);
  out.put(out.sh_dc, i, basis[0] * g);
  const std::size_t row = i * static_cast<std::size_t>(gaussians.sh_rest_rows);
  float weights[kMaxShCoefficients];
  weights[0] = 0.0f;
#pragma unroll
  for (int k = 1; k < kMaxShCoefficients; ++k) {
    weights[k] = 0.0f;
    if (k > used) continue;
    const std::size_t at = row + static_cast<std::size_t>(k - 1);
    weights[k] = dot(vec3_at(gaussians.sh_rest, at), g);
    out.put(out.sh_rest, at, basis[k] * g);
  }
  for (int k = used; !out.adds && k < gaussians.sh_rest_rows; ++k) {
    GradientViews::clear(out.sh_rest, row + static_cast<std::size_t>(k), 3);
  }
  if (gaussians.sh_degree == 0) return {0.0f, 0.0f, 0.0f};
  return through_normalise(ray.direction, ray.inverse_length,
                           sh_basis_gradient(gaussians.sh_degree, ray.direction, weights));
}

/// Results of the forward pass and of the backward pass of blending.
struct BackwardInputs {
  DeviceView<const std::uint8_t> visible;
  DeviceView<const SplatRecord> records;
  DeviceView<const float> moments;
  DeviceView<const float> feature_gradients;
  bool color;    ///< whether the view was rendered with colour
  int features;  ///< number that the view was rendered with
};

__global__ void __launch_bounds__(kBlockThreads)
    project_backward_kernel(GaussianViews gaussians, ProjectOptions options, BackwardInputs in, GradientViews out) {
  const std::size_t i = element_index();
  if (i >= in.visible.size()) return;
  if (in.visible[i] == 0) {
    out.clear_row(i, gaussians);
    return;
  }
  const auto moment = [&](Moment m) { return in.moments[i * kMomentColumns + static_cast<std::size_t>(m)]; };
  const float s = moment(kMomentS), s_x = moment(kMomentSX), s_y = moment(kMomentSY);
  const Vec3<float> g_color{moment(kMomentRed), moment(kMomentGreen), moment(kMomentBlue)};

  const Vec3<float> mean = vec3_at(gaussians.means, i);
  const Shape shape = shape_at(gaussians, i);
  const Projection<float> p = project_gaussian(options.camera, mean, shape.covariance, options.low_pass,
                                               options.compensate, options.near_plane);
  ProjectionGradient<float> up;
  up.mean = {p.conic.xx * s_x + p.conic.xy * s_y, p.conic.xy * s_x + p.conic.yy * s_y};
  up.conic = {-0.5f * moment(kMomentSXX), -moment(kMomentSXY), -0.5f * moment(kMomentSYY)};
  // dα/dσ = α/σ, and σ = opacity · compensation
  const float opacity = gaussians.opacities[i];
  const float drawn = opacity * p.compensation;
  const float g_drawn = drawn > 0.0f ? s / drawn : 0.0f;
  up.compensation = g_drawn * opacity;
  up.view_z = -(moment(kMomentInverseDepth) / (p.view.z * p.view.z));
  GaussianGeometryGradient<float> geometry =
      project_gaussian_backward(options.camera, p, shape.covariance, options.low_pass, options.compensate, up);

  if (!in.color) {
    out.clear_color(i, gaussians);
  } else if (!gaussians.colors.empty()) {
    out.put(out.colors, i, g_color);
  } else {
    // No gradient where the colour was clamped at zero.
    const SplatRecord record = in.records[i];
    const Vec3<float> g{record.red > 0.0f ? g_color.x : 0.0f, record.green > 0.0f ? g_color.y : 0.0f,
                        record.blue > 0.0f ? g_color.z : 0.0f};
    geometry.mean = geometry.mean + sh_backward(gaussians, out, i, ray_to(mean, options.camera), g);
  }
  out.put(out.means, i, geometry.mean);
  out.put(out.opacities, i, g_drawn * p.compensation);

  if (!gaussians.covariances.empty()) {
    const Symmetric3<float>& c = geometry.covariance;
    const float entries[6] = {c.xx, 2.0f * c.xy, 2.0f * c.xz, c.yy, 2.0f * c.yz, c.zz};  // full matrix
    for (std::size_t k = 0; k < 6; ++k) out.put(out.covariances, 6 * i + k, entries[k]);
  } else {
    Vec3<float> g_scale;
    Quaternion<float> g_rotation;
    covariance_backward(shape.scale, shape.unit, shape.inverse_length, shape.rotation, geometry.covariance, g_scale,
                        g_rotation);
    out.put(out.scales, i, g_scale);
    const float entries[4] = {g_rotation.w, g_rotation.x, g_rotation.y, g_rotation.z};
    for (std::size_t k = 0; k < 4; ++k) out.put(out.rotations, 4 * i + k, entries[k]);
  }
  const auto width = static_cast<std::size_t>(gaussians.features_per_gaussian);
  for (std::size_t f = 0; f < width; ++f) {
    // Zero if the view was rendered without features.
    out.put(out.features, i * width + f, in.features > 0 ? in.feature_gradients[i * width + f] : 0.0f);
  }
  const float from_log2 = 0.5f * kTwoLn2;  // kMomentAbsX, Y are derivatives of log2 α
  if (!out.screen_means.empty()) {
    out.screen_means[2 * i] = up.mean.x;
    out.screen_means[2 * i + 1] = up.mean.y;
  }
  if (!out.screen_means_abs.empty()) {
    out.screen_means_abs[2 * i] = from_log2 * moment(kMomentAbsX);
    out.screen_means_abs[2 * i + 1] = from_log2 * moment(kMomentAbsY);
  }
}

}  // namespace

void project(CudaFrame& frame, const Gaussians& gaussians, CudaStream& stream) {
  const std::size_t n = gaussians.count;
  frame.records.ensure(n);
  if (frame.options.box == BoxPolicy::ellipse) frame.ellipses.ensure(n);
  frame.boxes.ensure(n);
  frame.tile_counts.ensure(n);
  frame.visible.ensure(n);
  frame.places.ensure(n + 1);
  frame.radii.ensure(n);
  frame.channels.ensure(n * static_cast<std::size_t>(frame.extra_channels()));
  const ProjectResults out{frame.records.span(), frame.ellipses.span(), frame.boxes.span(), frame.tile_counts.span(),
                           frame.visible.span(), frame.places.span(),   frame.radii.span(), frame.channels.span(),
                           frame.color,          frame.features,        frame.inverse_depth};
  launch_each(stream, "project", project_kernel, n + 1, GaussianViews(gaussians), ProjectOptions(frame), out);
}

void project_backward(const CudaFrame& frame, const Gaussians& gaussians, const GaussianGradients& gradients,
                      CudaStream& stream) {
  const BackwardInputs in{frame.visible.span(),           frame.records.span(), frame.moments.span(),
                          frame.feature_gradients.span(), frame.color,          frame.features};
  launch_each(stream, "project_backward", project_backward_kernel, frame.gaussians, GaussianViews(gaussians),
              ProjectOptions(frame), in, GradientViews(gradients));
}

}  // namespace splatboost::cuda
