// SPDX-License-Identifier: Apache-2.0
#include "splatboost/rasterizer.h"

#include <chrono>
#include <cmath>
#include <string>

#include "frame.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

void check_rows(std::span<const float> rows, std::size_t n, std::size_t width, const char* name) {
  SPLATBOOST_CHECK(rows.size() == n * width, std::string(name) + " must hold " + std::to_string(n) + " × " +
                                                 std::to_string(width) + " numbers, not " +
                                                 std::to_string(rows.size()));
}

void check_optional(std::span<const float> values, std::size_t size, const char* name) {
  SPLATBOOST_CHECK(values.empty() || values.size() == size, std::string(name) + " must be empty or hold " +
                                                                std::to_string(size) + " numbers, not " +
                                                                std::to_string(values.size()));
}

void check_options(const RasterOptions& options) {
  SPLATBOOST_CHECK(options.beta > 0.0f && options.beta <= 1.0f, "beta must lie in (0, 1]");
  SPLATBOOST_CHECK(options.low_pass >= 0.0f && std::isfinite(options.low_pass),
                   "low_pass must be finite and not negative");
  SPLATBOOST_CHECK(options.near_plane > 0.0f && std::isfinite(options.near_plane),
                   "near_plane must be finite and above 0");
}

/// Runs a stage and notes how long it took.
template <class Stage>
void timed(double& seconds, Stage&& stage) {
  const auto start = std::chrono::steady_clock::now();
  stage();
  seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

void check_gaussians(const Gaussians& g) {
  const std::size_t n = g.count;
  SPLATBOOST_CHECK(n < (std::size_t{1} << 31), "at most 2^31 Gaussians");
  check_rows(g.means, n, 3, "means");
  check_rows(g.opacities, n, 1, "opacities");
  if (n == 0) return;
  SPLATBOOST_CHECK(g.covariances.empty() != (g.scales.empty() && g.rotations.empty()),
                   "give either scales and rotations, or covariances");
  if (g.covariances.empty()) {
    check_rows(g.scales, n, 3, "scales");
    check_rows(g.rotations, n, 4, "rotations");
  } else {
    check_rows(g.covariances, n, 6, "covariances");
  }
  SPLATBOOST_CHECK(g.colors.empty() != g.sh_dc.empty(), "give either spherical harmonics (sh_dc, sh_rest) or colors");
  if (g.colors.empty()) {
    check_rows(g.sh_dc, n, 3, "sh_dc");
    SPLATBOOST_CHECK(g.sh_degree >= 0 && g.sh_degree <= kMaxShDegree, "sh_degree must be 0 to 3");
    SPLATBOOST_CHECK(g.sh_rest_rows >= sh_coefficients(g.sh_degree) - 1, "sh_rest_rows is too small for sh_degree");
    check_rows(g.sh_rest, n, 3 * static_cast<std::size_t>(g.sh_rest_rows), "sh_rest");
  } else {
    check_rows(g.colors, n, 3, "colors");
  }
  SPLATBOOST_CHECK(g.features_per_gaussian >= 0 && g.features_per_gaussian <= kMaxFeatures,
                   "features_per_gaussian must be 0 to 8");
  check_rows(g.features, n, static_cast<std::size_t>(g.features_per_gaussian), "features");
}

struct Rasterizer::State {
  explicit State(Device device) : threads(device.threads()) {}
  Threads& threads;
  Frame frame;
  RasterSeconds seconds;
  bool drawn = false;
};

Rasterizer::Rasterizer(Device device) : state_(std::make_unique<State>(device)) {}
Rasterizer::~Rasterizer() = default;
Rasterizer::Rasterizer(Rasterizer&&) noexcept = default;
Rasterizer& Rasterizer::operator=(Rasterizer&&) noexcept = default;

void Rasterizer::forward(const Camera& camera, const Gaussians& gaussians, const RasterOptions& options,
                         const RasterImages& images) {
  check_camera(camera);
  check_gaussians(gaussians);
  check_options(options);
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  check_rows(images.color, pixels, 3, "color");
  check_optional(images.features, pixels * static_cast<std::size_t>(gaussians.features_per_gaussian), "image features");
  check_optional(images.inverse_depth, pixels, "inverse_depth");
  check_optional(images.alpha, pixels, "alpha");

  Frame& frame = state_->frame;
  frame.camera = camera;
  frame.options = options;
  frame.projection = make_projection_camera(camera);
  frame.gaussians = gaussians.count;
  frame.features = images.features.empty() ? 0 : gaussians.features_per_gaussian;
  frame.inverse_depth = !images.inverse_depth.empty();
  frame.tiles_x = camera.tiles_x();
  frame.tiles_y = camera.tiles_y();
  SPLATBOOST_CHECK(frame.tiles_x < 65536 && frame.tiles_y < 65536, "images are limited to 2^20 pixels a side");

  RasterSeconds& seconds = state_->seconds;
  timed(seconds.project, [&] { project(frame, gaussians, state_->threads); });
  timed(seconds.tile_lists, [&] { build_tile_lists(frame, state_->threads); });
  timed(seconds.blend, [&] { blend(frame, images, state_->threads); });
  state_->drawn = true;
}

void Rasterizer::backward(const Gaussians& gaussians, const RasterImageGradients& image_gradients,
                          const GaussianGradients& gradients) {
  Frame& frame = state_->frame;
  SPLATBOOST_CHECK(state_->drawn && gaussians.count == frame.gaussians,
                   "backward() needs a forward() of the same Gaussians before it");
  const std::size_t pixels =
      static_cast<std::size_t>(frame.camera.width) * static_cast<std::size_t>(frame.camera.height);
  const std::size_t n = gaussians.count;
  check_optional(image_gradients.color, 3 * pixels, "gradient of color");
  check_optional(image_gradients.features, pixels * static_cast<std::size_t>(frame.features), "gradient of features");
  check_optional(image_gradients.inverse_depth, frame.inverse_depth ? pixels : 0, "gradient of inverse_depth");
  check_optional(image_gradients.alpha, pixels, "gradient of alpha");
  check_optional(gradients.means, 3 * n, "gradients.means");
  check_optional(gradients.scales, gaussians.covariances.empty() ? 3 * n : 0, "gradients.scales");
  check_optional(gradients.rotations, gaussians.covariances.empty() ? 4 * n : 0, "gradients.rotations");
  check_optional(gradients.covariances, gaussians.covariances.empty() ? 0 : 6 * n, "gradients.covariances");
  check_optional(gradients.opacities, n, "gradients.opacities");
  check_optional(gradients.sh_dc, gaussians.colors.empty() ? 3 * n : 0, "gradients.sh_dc");
  check_optional(gradients.sh_rest,
                 (gaussians.colors.empty() ? 3 * n : 0) * static_cast<std::size_t>(gaussians.sh_rest_rows),
                 "gradients.sh_rest");
  check_optional(gradients.colors, gaussians.colors.empty() ? 0 : 3 * n, "gradients.colors");
  check_optional(gradients.features, n * static_cast<std::size_t>(gaussians.features_per_gaussian),
                 "gradients.features");
  check_optional(gradients.screen_means, 2 * n, "gradients.screen_means");
  check_optional(gradients.screen_means_abs, 2 * n, "gradients.screen_means_abs");

  RasterSeconds& seconds = state_->seconds;
  timed(seconds.blend_backward,
        [&] { blend_backward(frame, image_gradients, !gradients.screen_means_abs.empty(), state_->threads); });
  timed(seconds.project_backward, [&] { project_backward(frame, gaussians, gradients, state_->threads); });
}

void Rasterizer::count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) {
  const Frame& frame = state_->frame;
  SPLATBOOST_CHECK(state_->drawn, "count_flagged() needs a forward() before it");
  SPLATBOOST_CHECK(
      flagged.size() == static_cast<std::size_t>(frame.camera.width) * static_cast<std::size_t>(frame.camera.height),
      "flagged must have one byte a pixel");
  SPLATBOOST_CHECK(counts.size() == frame.gaussians, "counts must have one number a Gaussian");
  timed(state_->seconds.count, [&] { count_flagged_pixels(frame, flagged, counts, state_->threads); });
}

std::span<const std::uint8_t> Rasterizer::visible() const { return state_->frame.visible.span(); }
std::span<const std::int32_t> Rasterizer::screen_radii() const { return state_->frame.radii.span(); }

const RasterSeconds& Rasterizer::seconds() const { return state_->seconds; }

RasterCounts Rasterizer::counts() const {
  RasterCounts counts;
  const Frame& frame = state_->frame;
  if (!state_->drawn) return counts;
  for (const std::uint8_t seen : frame.visible.span()) counts.visible += seen;
  counts.tile_entries = frame.entries.size();
  return counts;
}

}  // namespace splatboost
