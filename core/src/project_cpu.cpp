// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "frame.h"
#include "sh_math.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "project_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once an instruction set
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

glm::vec3 vec3_at(std::span<const float> rows, std::size_t i) {
  return {rows[3 * i], rows[3 * i + 1], rows[3 * i + 2]};
}

glm::vec4 vec4_at(std::span<const float> rows, std::size_t i) {
  return {rows[4 * i], rows[4 * i + 1], rows[4 * i + 2], rows[4 * i + 3]};
}

/// Covariance of a Gaussian, and the rotation it was made of where there is one.
Symmetric3 covariance_at(const Gaussians& gaussians, std::size_t i, glm::mat3& rotation) {
  if (!gaussians.covariances.empty()) {
    const float* c = &gaussians.covariances[6 * i];
    return {c[0], c[1], c[2], c[3], c[4], c[5]};
  }
  rotation = rotation_of(glm::normalize(vec4_at(gaussians.rotations, i)));
  return covariance_of(vec3_at(gaussians.scales, i), rotation);
}

glm::vec3 sh_color(const Gaussians& gaussians, std::size_t i, glm::vec3 direction) {
  float basis[kMaxShCoefficients];
  sh_basis(gaussians.sh_degree, direction, basis);
  glm::vec3 color = glm::vec3(0.5f) + basis[0] * vec3_at(gaussians.sh_dc, i);
  const int used = sh_coefficients(gaussians.sh_degree) - 1;
  const float* rest = gaussians.sh_rest.data() + 3 * i * static_cast<std::size_t>(gaussians.sh_rest_rows);
  for (int k = 0; k < used; ++k) color += basis[k + 1] * glm::vec3(rest[3 * k], rest[3 * k + 1], rest[3 * k + 2]);
  return glm::max(color, glm::vec3(0.0f));
}

void set_bounding_tiles(const Frame& frame, Splat& splat) {
  TileRange x, y;
  if (frame.options.box == BoxPolicy::square) {
    const float radius = square_radius(splat.covariance);
    x = square_tiles(splat.mean.x, radius, frame.tiles_x);
    y = square_tiles(splat.mean.y, radius, frame.tiles_y);
  } else {
    const float t = frame.options.beta * splat.reach;
    if (!(t > 0.0f)) return;
    const Ellipse ellipse = make_ellipse(splat.mean, splat.covariance, splat.conic, t);
    x = tiles_meeting(ellipse.mean.x - ellipse.half_width - kTileSlack,
                      ellipse.mean.x + ellipse.half_width + kTileSlack, frame.tiles_x);
    y = ellipse_tile_rows(ellipse, frame.tiles_y);
  }
  if (x.begin >= x.end || y.begin >= y.end) return;
  splat.tile_x0 = static_cast<std::uint16_t>(x.begin);
  splat.tile_x1 = static_cast<std::uint16_t>(x.end);
  splat.tile_y0 = static_cast<std::uint16_t>(y.begin);
  splat.tile_y1 = static_cast<std::uint16_t>(y.end);
}

void project_range(Frame& frame, const Gaussians& gaussians, std::size_t begin, std::size_t end) {
  const RasterOptions& options = frame.options;
  const ProjectionCamera& camera = frame.projection;
  for (std::size_t i = begin; i < end; ++i) {
    Splat& splat = frame.splats[i];
    splat.tile_x0 = splat.tile_x1 = splat.tile_y0 = splat.tile_y1 = 0;
    frame.radii[i] = 0;
    frame.tile_rows[i] = 0;
    const glm::vec3 mean = vec3_at(gaussians.means, i);
    glm::mat3 rotation;
    const Symmetric3 covariance = covariance_at(gaussians, i, rotation);
    const Projection p =
        project_gaussian(camera, mean, covariance, options.low_pass, options.compensate_opacity, options.near_plane);
    if (!p.valid) continue;
    splat.mean = p.mean;
    splat.covariance = p.covariance;
    splat.conic = p.conic;
    splat.depth = p.view.z;
    splat.opacity = gaussians.opacities[i] * p.compensation;
    if (!(splat.opacity >= 0.0f)) continue;  // NaN
    splat.reach = reach_of(splat.opacity);
    set_bounding_tiles(frame, splat);
    if (splat.tile_x0 >= splat.tile_x1) continue;
    frame.tile_rows[i] = static_cast<std::uint16_t>(splat.tile_y1 - splat.tile_y0);
    frame.depth_bits[i] = std::bit_cast<std::uint32_t>(splat.depth);  // positive, so these order as depths do
    frame.radii[i] = static_cast<std::int32_t>(min_of(square_radius(p.covariance), 1e9f));
    if (!gaussians.colors.empty()) {
      splat.color = vec3_at(gaussians.colors, i);
    } else {
      splat.color = sh_color(gaussians, i, glm::normalize(mean - camera.centre));
    }
  }
}

/// Sum of a splat's entries in the order of the lists.
EntryMoments gather(const Frame& frame, std::size_t i) {
  using Lane = std::array<float, sizeof(EntryMoments) / sizeof(float)>;
  Lane sum{};
  for (std::uint32_t slot = frame.splat_begin[i]; slot < frame.splat_begin[i + 1]; ++slot) {
    const auto entry = std::bit_cast<Lane>(frame.entry_moments[slot]);
    for (std::size_t c = 0; c < sum.size(); ++c) sum[c] += entry[c];
  }
  return std::bit_cast<EntryMoments>(sum);
}

void add(std::span<float> rows, std::size_t width, std::size_t i, const float* values, GradientMode mode) {
  if (rows.empty()) return;
  float* row = rows.data() + width * i;
  if (mode == GradientMode::overwrite) {
    for (std::size_t k = 0; k < width; ++k) row[k] = values[k];
  } else {
    for (std::size_t k = 0; k < width; ++k) row[k] += values[k];
  }
}

void clear(std::span<float> rows, std::size_t width, std::size_t i) {
  if (!rows.empty()) std::memset(rows.data() + width * i, 0, width * sizeof(float));
}

/// Gradient through spherical harmonics: writes the coefficients', returns the mean's.
glm::vec3 sh_backward(const Gaussians& gaussians, const GaussianGradients& gradients, std::size_t i, glm::vec3 mean,
                      glm::vec3 centre, glm::vec3 g_color) {
  const int degree = gaussians.sh_degree;
  const int used = sh_coefficients(degree);
  const glm::vec3 ray = mean - centre;
  const float length = glm::length(ray);
  const glm::vec3 direction = ray / length;
  float basis[kMaxShCoefficients];
  sh_basis(degree, direction, basis);

  const float g_dc[3] = {basis[0] * g_color.x, basis[0] * g_color.y, basis[0] * g_color.z};
  add(gradients.sh_dc, 3, i, g_dc, gradients.mode);

  const std::size_t width = 3 * static_cast<std::size_t>(gaussians.sh_rest_rows);
  if (!gradients.sh_rest.empty()) {
    float* row = gradients.sh_rest.data() + width * i;
    if (gradients.mode == GradientMode::overwrite) {
      for (int k = 1; k < used; ++k) {
        for (int c = 0; c < 3; ++c) row[3 * (k - 1) + c] = basis[k] * g_color[c];
      }
      const std::size_t written = 3 * static_cast<std::size_t>(used - 1);
      std::memset(row + written, 0, (width - written) * sizeof(float));
    } else {
      for (int k = 1; k < used; ++k) {
        for (int c = 0; c < 3; ++c) row[3 * (k - 1) + c] += basis[k] * g_color[c];
      }
    }
  }
  if (degree == 0) return glm::vec3(0.0f);
  const float* rest = gaussians.sh_rest.data() + width * i;
  float weights[kMaxShCoefficients];
  weights[0] = 0;
  for (int k = 1; k < used; ++k) {
    weights[k] = rest[3 * (k - 1)] * g_color.x + rest[3 * (k - 1) + 1] * g_color.y + rest[3 * (k - 1) + 2] * g_color.z;
  }
  return through_normalise(direction, length, sh_basis_gradient(degree, direction, weights));
}

void clear_gaussian(const GaussianGradients& g, std::size_t i, std::size_t rest_width, std::size_t features) {
  clear(g.means, 3, i);
  clear(g.scales, 3, i);
  clear(g.rotations, 4, i);
  clear(g.covariances, 6, i);
  clear(g.opacities, 1, i);
  clear(g.sh_dc, 3, i);
  clear(g.sh_rest, rest_width, i);
  clear(g.colors, 3, i);
  clear(g.features, features, i);
}

constexpr float kPerLog2 = 0.5f / kHalfLog2E;  // from log2 α to ln α

void backward_one(const Frame& frame, const Gaussians& gaussians, const GaussianGradients& out, std::size_t i) {
  const Splat& splat = frame.splats[i];
  const ProjectionCamera& camera = frame.projection;
  const RasterOptions& options = frame.options;
  const EntryMoments g = gather(frame, i);

  const glm::vec3 mean = vec3_at(gaussians.means, i);
  glm::mat3 rotation;
  const Symmetric3 covariance = covariance_at(gaussians, i, rotation);
  const Projection p =
      project_gaussian(camera, mean, covariance, options.low_pass, options.compensate_opacity, options.near_plane);

  ProjectionGradient up;
  up.mean = {p.conic.xx * g.s_x + p.conic.xy * g.s_y, p.conic.xy * g.s_x + p.conic.yy * g.s_y};
  up.conic = {-0.5f * g.s_xx, -g.s_xy, -0.5f * g.s_yy};
  const float g_drawn_opacity = splat.opacity > 0.0f ? g.s / splat.opacity : 0.0f;
  up.compensation = g_drawn_opacity * gaussians.opacities[i];
  up.view_z = -g.inverse_depth / (splat.depth * splat.depth);
  GaussianGeometryGradient geometry =
      project_gaussian_backward(camera, p, covariance, options.low_pass, options.compensate_opacity, up);

  const glm::vec3 g_color(g.red, g.green, g.blue);
  if (!gaussians.colors.empty()) {
    add(out.colors, 3, i, &g_color.x, out.mode);
  } else {
    const glm::vec3 unclamped = g_color * glm::vec3(splat.color.x > 0.0f, splat.color.y > 0.0f, splat.color.z > 0.0f);
    geometry.mean += sh_backward(gaussians, out, i, mean, camera.centre, unclamped);
  }
  add(out.means, 3, i, &geometry.mean.x, out.mode);
  const float g_opacity = g_drawn_opacity * p.compensation;
  add(out.opacities, 1, i, &g_opacity, out.mode);

  if (!gaussians.covariances.empty()) {
    const Symmetric3& c = geometry.covariance;
    const float entries[6] = {c.xx, 2 * c.xy, 2 * c.xz, c.yy, 2 * c.yz, c.zz};  // off-diagonals stand in two places
    add(out.covariances, 6, i, entries, out.mode);
  } else {
    glm::vec3 g_scale;
    glm::vec4 g_rotation;
    covariance_backward(vec3_at(gaussians.scales, i), vec4_at(gaussians.rotations, i), rotation, geometry.covariance,
                        g_scale, g_rotation);
    add(out.scales, 3, i, &g_scale.x, out.mode);
    add(out.rotations, 4, i, &g_rotation.x, out.mode);
  }

  if (!out.features.empty()) {
    float sum[kMaxFeatures] = {};
    const auto drawn = static_cast<std::size_t>(frame.features);  // none, if the view was drawn without them
    for (std::size_t slot = frame.splat_begin[i]; drawn > 0 && slot < frame.splat_begin[i + 1]; ++slot) {
      const float* entry = frame.entry_channel_gradients.data() + drawn * slot;
      for (std::size_t f = 0; f < drawn; ++f) sum[f] += entry[f];
    }
    add(out.features, static_cast<std::size_t>(gaussians.features_per_gaussian), i, sum, out.mode);
  }
  if (!out.screen_means.empty()) {
    out.screen_means[2 * i] = up.mean.x;
    out.screen_means[2 * i + 1] = up.mean.y;
  }
  if (!out.screen_means_abs.empty()) {
    out.screen_means_abs[2 * i] = g.abs_x * kPerLog2;
    out.screen_means_abs[2 * i + 1] = g.abs_y * kPerLog2;
  }
}

void backward_range(const Frame& frame, const Gaussians& gaussians, const GaussianGradients& gradients,
                    std::size_t begin, std::size_t end) {
  const std::size_t rest_width = 3 * static_cast<std::size_t>(gaussians.sh_rest_rows);
  const auto feature_width = static_cast<std::size_t>(gaussians.features_per_gaussian);
  for (std::size_t i = begin; i < end; ++i) {
    if (frame.visible[i]) {
      backward_one(frame, gaussians, gradients, i);
      continue;
    }
    if (gradients.mode == GradientMode::overwrite) clear_gaussian(gradients, i, rest_width, feature_width);
    clear(gradients.screen_means, 2, i);
    clear(gradients.screen_means_abs, 2, i);
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
constexpr std::size_t kGrain = 512;
}  // namespace

void project(Frame& frame, const Gaussians& gaussians, Threads& threads) {
  frame.splats.ensure(gaussians.count);
  frame.radii.ensure(gaussians.count);
  frame.tile_rows.ensure(gaussians.count);
  frame.depth_bits.ensure(gaussians.count);
  threads.for_range(gaussians.count, kGrain, [&](std::size_t begin, std::size_t end) {
    HWY_DYNAMIC_DISPATCH(project_range)(frame, gaussians, begin, end);
  });
}

void project_backward(const Frame& frame, const Gaussians& gaussians, const GaussianGradients& gradients,
                      Threads& threads) {
  threads.for_range(frame.gaussians, kGrain, [&](std::size_t begin, std::size_t end) {
    HWY_DYNAMIC_DISPATCH(backward_range)(frame, gaussians, gradients, begin, end);
  });
}

}  // namespace splatboost
#endif  // HWY_ONCE
