// SPDX-License-Identifier: Apache-2.0
#include <vector>

#include "convexes/cuda_convex_frame.h"
#include "convexes/cuda_ops.h"
#include "rasterizer/cuda_raster_clock.h"

namespace splatboost::cuda {
namespace {

class CudaConvexRasterizer : public ConvexBackend {
 public:
  explicit CudaConvexRasterizer(CudaStream& stream) : stream_(stream), frame_(stream), clock_(stream) {}

  void forward(const Camera& camera, const Convexes& convexes, const ConvexOptions& options, std::span<float> color,
               std::span<float> alpha) override {
    frame_.camera = camera;
    frame_.options = options;
    frame_.view = make_viewpoint(camera, options);
    frame_.convexes = convexes.count;
    clock_.start.record();
    project_convexes(frame_, convexes, stream_);
    clock_.projected.record();
    entries_ = build_convex_lists(frame_, stream_);
    clock_.listed.record();
    blend_convexes(frame_, color, alpha, stream_);
    clock_.blended.record();
  }

  void backward(const Convexes& convexes, std::span<const float> color, std::span<const float> alpha,
                const ConvexGradients& gradients) override {
    clock_.backward_start.record();
    blend_convexes_backward(frame_, color, alpha, stream_);
    clock_.blended_backward.record();
    project_convexes_backward(frame_, convexes, gradients, stream_);
    clock_.projected_backward.record();
  }

  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    clock_.count_start.record();
    count_flagged_convexes(frame_, flagged, counts, stream_);
    clock_.counted.record();
  }

  void add_weights(std::span<std::int32_t> weights) override {
    clock_.count_start.record();
    add_convex_weights(frame_, weights, stream_);
    clock_.counted.record();
  }

  /// forward() waits for the size of the lists, so that nothing has to be drawn again.
  bool settle() override { return false; }
  std::span<const std::uint8_t> visible() const override { return frame_.visible.span(); }

  ConvexCounts counts() override {
    ConvexCounts counts;
    for (const std::uint8_t seen : frame_.visible.to_host()) counts.visible += seen;
    counts.tile_entries = entries_;
    return counts;
  }

  const RasterSeconds& seconds() override { return seconds_ = clock_.seconds(); }

 private:
  CudaStream& stream_;
  CudaConvexFrame frame_;
  std::size_t entries_ = 0;
  RasterSeconds seconds_;
  RasterClock clock_;
};

}  // namespace

std::unique_ptr<ConvexBackend> make_convex_rasterizer(CudaStream& stream) {
  return std::make_unique<CudaConvexRasterizer>(stream);
}

}  // namespace splatboost::cuda
