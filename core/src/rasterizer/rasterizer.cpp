// SPDX-License-Identifier: Apache-2.0
#include "splatboost/rasterizer.h"

#include <cmath>

#include "projection/check_arrays.h"
#include "rasterizer/cuda_ops.h"
#include "rasterizer/rasterizer_backend.h"
#include "splatboost/errors.h"
#include "splatboost/sh_factors.h"

namespace splatboost {
namespace {

void check_options(const RasterOptions& options) {
  SPLATBOOST_CHECK(options.beta > 0.0f && options.beta <= 1.0f, "beta must lie in (0, 1]");
  SPLATBOOST_CHECK(options.low_pass >= 0.0f && std::isfinite(options.low_pass),
                   "low_pass must be finite and not negative");
  SPLATBOOST_CHECK(options.near_plane > 0.0f && std::isfinite(options.near_plane),
                   "near_plane must be finite and above 0");
}

}  // namespace

void check_gaussians(const Gaussians& g) {
  const std::size_t n = g.count;
  SPLATBOOST_CHECK(n < (std::size_t{1} << 31), "at most 2^31 Gaussians");
  check_rows(g.means, n, 3, "means");
  check_rows(g.opacities, n, 1, "opacities");
  SPLATBOOST_CHECK(g.features_per_gaussian >= 0 && g.features_per_gaussian <= kMaxFeatures,
                   "features_per_gaussian must be 0 to 8");
  if (n == 0) return;
  SPLATBOOST_CHECK(g.covariances.empty() != (g.scales.empty() && g.rotations.empty()),
                   "give either scales and rotations, or covariances");
  if (g.covariances.empty()) {
    check_rows(g.scales, n, 3, "scales");
    check_rows(g.rotations, n, 4, "rotations");
  } else {
    check_rows(g.covariances, n, 6, "covariances");
  }
  check_colors(g);
  check_rows(g.features, n, static_cast<std::size_t>(g.features_per_gaussian), "features");
}

struct Rasterizer::State {
  explicit State(Device device)
      : backend(device.is_cuda() ? cuda::make_rasterizer(device.stream()) : make_cpu_rasterizer(device.threads())) {}
  std::unique_ptr<RasterizerBackend> backend;
  // Of the last forward():
  bool drawn = false;
  std::size_t pixels = 0;
  std::size_t gaussians = 0;
  bool color = true;
  int features = 0;
  bool inverse_depth = false;
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
  check_optional(images.color, 3 * pixels, "color");
  check_optional(images.features, pixels * static_cast<std::size_t>(gaussians.features_per_gaussian), "image features");
  check_optional(images.inverse_depth, pixels, "inverse_depth");
  check_optional(images.alpha, pixels, "alpha");
  check_image_size(camera);

  State& state = *state_;
  state.pixels = pixels;
  state.gaussians = gaussians.count;
  state.color = !images.color.empty();
  state.features = images.features.empty() ? 0 : gaussians.features_per_gaussian;
  state.inverse_depth = !images.inverse_depth.empty();
  state.drawn = false;  // if forward() throws
  state.backend->forward(camera, gaussians, options, images);
  state.drawn = true;
}

void Rasterizer::backward(const Gaussians& gaussians, const RasterImageGradients& image_gradients,
                          const GaussianGradients& gradients) {
  const State& state = *state_;
  SPLATBOOST_CHECK(state.drawn && gaussians.count == state.gaussians,
                   "backward() needs a forward() of the same Gaussians before it");
  const std::size_t pixels = state.pixels;
  const std::size_t n = gaussians.count;
  check_optional(image_gradients.color, state.color ? 3 * pixels : 0, "gradient of color");
  check_optional(image_gradients.features, pixels * static_cast<std::size_t>(state.features), "gradient of features");
  check_optional(image_gradients.inverse_depth, state.inverse_depth ? pixels : 0, "gradient of inverse_depth");
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
  SPLATBOOST_CHECK(gradients.sh_rest.empty() || gradients.sh_factors.empty(),
                   "gradients.sh_factors is written instead of gradients.sh_rest: one of them must be empty");
  check_optional(gradients.sh_factors, gaussians.colors.empty() ? kShFactors * n : 0, "gradients.sh_factors");
  check_optional(gradients.colors, gaussians.colors.empty() ? 0 : 3 * n, "gradients.colors");
  check_optional(gradients.features, n * static_cast<std::size_t>(gaussians.features_per_gaussian),
                 "gradients.features");
  check_optional(gradients.screen_means, 2 * n, "gradients.screen_means");
  check_optional(gradients.screen_means_abs, 2 * n, "gradients.screen_means_abs");

  state_->backend->backward(gaussians, image_gradients, gradients);
}

void Rasterizer::count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) {
  const State& state = *state_;
  SPLATBOOST_CHECK(state.drawn, "count_flagged() needs a forward() before it");
  SPLATBOOST_CHECK(flagged.size() == state.pixels, "flagged must have one byte per pixel");
  SPLATBOOST_CHECK(counts.size() == state.gaussians, "counts must have one number per Gaussian");
  state_->backend->count_flagged(flagged, counts);
}

void Rasterizer::count_observed(float min_transmittance, std::span<std::int32_t> counts) {
  const State& state = *state_;
  SPLATBOOST_CHECK(state.drawn, "count_observed() needs a forward() before it");
  SPLATBOOST_CHECK(min_transmittance >= 0 && min_transmittance < 1, "min_transmittance must lie in [0, 1)");
  SPLATBOOST_CHECK(counts.size() == state.gaussians, "counts must have one number per Gaussian");
  state_->backend->count_observed(min_transmittance, counts);
}

void Rasterizer::add_weights(std::span<std::int32_t> weights) {
  const State& state = *state_;
  SPLATBOOST_CHECK(state.drawn, "add_weights() needs a forward() before it");
  SPLATBOOST_CHECK(weights.size() == state.gaussians, "weights must have one number per Gaussian");
  state_->backend->add_weights(weights);
}

bool Rasterizer::settle() { return state_->drawn && state_->backend->settle(); }

std::span<const std::uint8_t> Rasterizer::visible() const { return state_->backend->visible(); }
std::span<const std::int32_t> Rasterizer::screen_radii() const { return state_->backend->screen_radii(); }

const RasterSeconds& Rasterizer::seconds() const { return state_->backend->seconds(); }

RasterCounts Rasterizer::counts() const { return state_->drawn ? state_->backend->counts() : RasterCounts{}; }

}  // namespace splatboost
