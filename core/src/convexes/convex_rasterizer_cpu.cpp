// SPDX-License-Identifier: Apache-2.0
#include "convexes/convex_backend.h"
#include "convexes/convex_frame.h"
#include "rasterizer/raster_clock.h"

namespace splatboost {
namespace {

class CpuConvexRasterizer : public ConvexBackend {
 public:
  explicit CpuConvexRasterizer(const Threads& threads) : threads_(threads) {}

  void forward(const Camera& camera, const Convexes& convexes, const ConvexOptions& options, std::span<float> color,
               std::span<float> alpha) override {
    frame_.camera = camera;
    frame_.options = options;
    frame_.primitives = convexes.count;
    frame_.tiles_x = camera.tiles_x();
    frame_.tiles_y = camera.tiles_y();
    timed(seconds_.project, [&] { project_convexes(frame_, convexes, threads_); });
    timed(seconds_.tile_lists, [&] { build_tile_lists(frame_, threads_); });
    timed(seconds_.blend, [&] { blend_convexes(frame_, color, alpha, threads_); });
  }

  void backward(const Convexes& convexes, std::span<const float> color, std::span<const float> alpha,
                const ConvexGradients& gradients) override {
    timed(seconds_.blend_backward, [&] { blend_convexes_backward(frame_, color, alpha, threads_); });
    timed(seconds_.project_backward, [&] { project_convexes_backward(frame_, convexes, gradients, threads_); });
  }

  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    timed(seconds_.count, [&] { count_flagged_convexes(frame_, flagged, counts, threads_); });
  }

  void add_weights(std::span<std::int32_t> weights) override {
    timed(seconds_.count, [&] { add_convex_weights(frame_, weights, threads_); });
  }

  bool settle() override { return false; }
  std::span<const std::uint8_t> visible() const override { return frame_.visible.span(); }
  const RasterSeconds& seconds() override { return seconds_; }

  ConvexCounts counts() override {
    ConvexCounts counts;
    for (const std::uint8_t seen : frame_.visible.span()) counts.visible += seen;
    counts.tile_entries = frame_.entries.size();
    return counts;
  }

 private:
  Threads threads_;
  ConvexFrame frame_;
  RasterSeconds seconds_;
};

}  // namespace

std::unique_ptr<ConvexBackend> make_cpu_convex_rasterizer(const Threads& threads) {
  return std::make_unique<CpuConvexRasterizer>(threads);
}

}  // namespace splatboost
