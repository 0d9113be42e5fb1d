// SPDX-License-Identifier: Apache-2.0
#include "projection/frame.h"
#include "rasterizer/raster_clock.h"
#include "rasterizer/rasterizer_backend.h"

namespace splatboost {
namespace {

class CpuRasterizer : public RasterizerBackend {
 public:
  explicit CpuRasterizer(const Threads& threads) : threads_(threads) {}

  void forward(const Camera& camera, const Gaussians& gaussians, const RasterOptions& options,
               const RasterImages& images) override {
    frame_.camera = camera;
    frame_.options = options;
    frame_.projection = make_projection_camera(camera);
    frame_.primitives = gaussians.count;
    frame_.color = !images.color.empty();
    frame_.features = images.features.empty() ? 0 : gaussians.features_per_gaussian;
    frame_.inverse_depth = !images.inverse_depth.empty();
    frame_.tiles_x = camera.tiles_x();
    frame_.tiles_y = camera.tiles_y();
    timed(seconds_.project, [&] { project(frame_, gaussians, threads_); });
    timed(seconds_.tile_lists, [&] { build_tile_lists(frame_, threads_); });
    timed(seconds_.blend, [&] { blend(frame_, images, threads_); });
  }

  void backward(const Gaussians& gaussians, const RasterImageGradients& image_gradients,
                const GaussianGradients& gradients) override {
    timed(seconds_.blend_backward,
          [&] { blend_backward(frame_, image_gradients, !gradients.screen_means_abs.empty(), threads_); });
    timed(seconds_.project_backward, [&] { project_backward(frame_, gaussians, gradients, threads_); });
  }

  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    timed(seconds_.count, [&] { count_flagged_pixels(frame_, flagged, counts, threads_); });
  }

  void count_observed(float min_transmittance, std::span<std::int32_t> counts) override {
    timed(seconds_.count, [&] { count_observed_pixels(frame_, min_transmittance, counts, threads_); });
  }

  void add_weights(std::span<std::int32_t> weights) override {
    timed(seconds_.count, [&] { add_blending_weights(frame_, weights, threads_); });
  }

  bool settle() override { return false; }
  std::span<const std::uint8_t> visible() const override { return frame_.visible.span(); }
  std::span<const std::int32_t> screen_radii() const override { return frame_.radii.span(); }
  const RasterSeconds& seconds() override { return seconds_; }

  RasterCounts counts() override {
    RasterCounts counts;
    for (const std::uint8_t seen : frame_.visible.span()) counts.visible += seen;
    counts.tile_entries = frame_.entries.size();
    return counts;
  }

 private:
  Threads threads_;
  Frame frame_;
  RasterSeconds seconds_;
};

}  // namespace

std::unique_ptr<RasterizerBackend> make_cpu_rasterizer(const Threads& threads) {
  return std::make_unique<CpuRasterizer>(threads);
}

}  // namespace splatboost
