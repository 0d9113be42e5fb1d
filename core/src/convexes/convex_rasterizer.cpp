// SPDX-License-Identifier: Apache-2.0
#include "splatboost/convex_rasterizer.h"

#include <cmath>

#include "convexes/convex_backend.h"
#include "convexes/cuda_ops.h"
#include "projection/check_arrays.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

void check_options(const ConvexOptions& options) {
  SPLATBOOST_CHECK(options.beta > 0.0f && options.beta <= 1.0f, "beta must lie in (0, 1]");
  SPLATBOOST_CHECK(options.near_plane > 0.0f && std::isfinite(options.near_plane),
                   "near_plane must be finite and above 0");
  SPLATBOOST_CHECK(options.pixel_size > 0.0f && std::isfinite(options.pixel_size),
                   "pixel_size must be finite and above 0");
}

}  // namespace

void check_convexes(const Convexes& c) {
  const std::size_t n = c.count;
  SPLATBOOST_CHECK(n < (std::size_t{1} << 31), "at most 2^31 convexes");
  SPLATBOOST_CHECK(c.points_per_convex >= kMinConvexPoints && c.points_per_convex <= kMaxConvexPoints,
                   "points_per_convex must be 3 to 8");
  check_rows(c.points, n, 3 * static_cast<std::size_t>(c.points_per_convex), "points");
  check_rows(c.smoothness, n, 1, "smoothness");
  check_rows(c.sharpness, n, 1, "sharpness");
  check_rows(c.opacities, n, 1, "opacities");
  if (n == 0) return;
  check_colors(c);
}

struct ConvexRasterizer::State {
  explicit State(Device device)
      : backend(device.is_cuda() ? cuda::make_convex_rasterizer(device.stream())
                                 : make_cpu_convex_rasterizer(device.threads())) {}
  std::unique_ptr<ConvexBackend> backend;
  // Of the last forward():
  bool drawn = false;
  std::size_t pixels = 0;
  std::size_t convexes = 0;
};

ConvexRasterizer::ConvexRasterizer(Device device) : state_(std::make_unique<State>(device)) {}
ConvexRasterizer::~ConvexRasterizer() = default;
ConvexRasterizer::ConvexRasterizer(ConvexRasterizer&&) noexcept = default;
ConvexRasterizer& ConvexRasterizer::operator=(ConvexRasterizer&&) noexcept = default;

void ConvexRasterizer::forward(const Camera& camera, const Convexes& convexes, const ConvexOptions& options,
                               std::span<float> color, std::span<float> alpha) {
  check_camera(camera);
  check_convexes(convexes);
  check_options(options);
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  check_rows(color, pixels, 3, "color");
  check_optional(alpha, pixels, "alpha");
  check_image_size(camera);
  State& state = *state_;
  state.pixels = pixels;
  state.convexes = convexes.count;
  state.drawn = false;  // if forward() throws
  state.backend->forward(camera, convexes, options, color, alpha);
  state.drawn = true;
}

void ConvexRasterizer::backward(const Convexes& convexes, std::span<const float> color, std::span<const float> alpha,
                                const ConvexGradients& gradients) {
  const State& state = *state_;
  SPLATBOOST_CHECK(state.drawn && convexes.count == state.convexes,
                   "backward() needs a forward() of the same convexes before it");
  const std::size_t n = convexes.count;
  const bool given_colors = !convexes.colors.empty();
  check_optional(color, 3 * state.pixels, "gradient of color");
  check_optional(alpha, state.pixels, "gradient of alpha");
  check_optional(gradients.points, 3 * n * static_cast<std::size_t>(convexes.points_per_convex), "gradients.points");
  check_optional(gradients.smoothness, n, "gradients.smoothness");
  check_optional(gradients.sharpness, n, "gradients.sharpness");
  check_optional(gradients.opacities, n, "gradients.opacities");
  check_optional(gradients.sh_dc, given_colors ? 0 : 3 * n, "gradients.sh_dc");
  check_optional(gradients.sh_rest, given_colors ? 0 : 3 * n * static_cast<std::size_t>(convexes.sh_rest_rows),
                 "gradients.sh_rest");
  check_optional(gradients.colors, given_colors ? 3 * n : 0, "gradients.colors");
  check_optional(gradients.view_sharpness, n, "gradients.view_sharpness");
  check_optional(gradients.view_sharpness_abs, n, "gradients.view_sharpness_abs");
  check_optional(gradients.screen_points, 3 * n, "gradients.screen_points");
  state_->backend->backward(convexes, color, alpha, gradients);
}

void ConvexRasterizer::count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) {
  const State& state = *state_;
  SPLATBOOST_CHECK(state.drawn, "count_flagged() needs a forward() before it");
  SPLATBOOST_CHECK(flagged.size() == state.pixels, "flagged must have one byte per pixel");
  SPLATBOOST_CHECK(counts.size() == state.convexes, "counts must have one number per convex");
  state_->backend->count_flagged(flagged, counts);
}

void ConvexRasterizer::add_weights(std::span<std::int32_t> weights) {
  const State& state = *state_;
  SPLATBOOST_CHECK(state.drawn, "add_weights() needs a forward() before it");
  SPLATBOOST_CHECK(weights.size() == state.convexes, "weights must have one number per convex");
  state_->backend->add_weights(weights);
}

bool ConvexRasterizer::settle() { return state_->drawn && state_->backend->settle(); }
std::span<const std::uint8_t> ConvexRasterizer::visible() const { return state_->backend->visible(); }
const RasterSeconds& ConvexRasterizer::seconds() const { return state_->backend->seconds(); }
ConvexCounts ConvexRasterizer::counts() const { return state_->drawn ? state_->backend->counts() : ConvexCounts{}; }

}  // namespace splatboost
