// SPDX-License-Identifier: Apache-2.0
#include <vector>

#include "convexes/cuda_convex_frame.h"
#include "convexes/cuda_ops.h"
#include "device/cuda_event.h"

namespace splatboost::cuda {
namespace {

class CudaConvexRasterizer : public ConvexBackend {
 public:
  explicit CudaConvexRasterizer(CudaStream& stream)
      : stream_(stream),
        frame_(stream),
        start_(stream, cudaEventDefault),
        projected_(stream, cudaEventDefault),
        listed_(stream, cudaEventDefault),
        blended_(stream, cudaEventDefault),
        backward_start_(stream, cudaEventDefault),
        blended_backward_(stream, cudaEventDefault),
        projected_backward_(stream, cudaEventDefault),
        count_start_(stream, cudaEventDefault),
        counted_(stream, cudaEventDefault) {}

  void forward(const Camera& camera, const Convexes& convexes, const ConvexOptions& options, std::span<float> color,
               std::span<float> alpha) override {
    frame_.camera = camera;
    frame_.options = options;
    frame_.view = make_viewpoint(camera, options);
    frame_.convexes = convexes.count;
    start_.record();
    project_convexes(frame_, convexes, stream_);
    projected_.record();
    entries_ = build_convex_lists(frame_, stream_);
    listed_.record();
    blend_convexes(frame_, color, alpha, stream_);
    blended_.record();
  }

  void backward(const Convexes& convexes, std::span<const float> color, std::span<const float> alpha,
                const ConvexGradients& gradients) override {
    backward_start_.record();
    blend_convexes_backward(frame_, color, alpha, stream_);
    blended_backward_.record();
    project_convexes_backward(frame_, convexes, gradients, stream_);
    projected_backward_.record();
  }

  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    count_start_.record();
    count_flagged_convexes(frame_, flagged, counts, stream_);
    counted_.record();
  }

  void add_weights(std::span<std::int32_t> weights) override { add_convex_weights(frame_, weights, stream_); }

  /// forward() waits for the size of the lists, so that nothing has to be drawn again.
  bool settle() override { return false; }
  std::span<const std::uint8_t> visible() const override { return frame_.visible.span(); }

  ConvexCounts counts() override {
    ConvexCounts counts;
    for (const std::uint8_t seen : frame_.visible.to_host()) counts.visible += seen;
    counts.tile_entries = entries_;
    return counts;
  }

  const RasterSeconds& seconds() override {
    stream_.synchronize();
    seconds_.project = seconds_between(start_, projected_);
    seconds_.tile_lists = seconds_between(projected_, listed_);
    seconds_.blend = seconds_between(listed_, blended_);
    seconds_.blend_backward = seconds_between(backward_start_, blended_backward_);
    seconds_.project_backward = seconds_between(blended_backward_, projected_backward_);
    seconds_.count = seconds_between(count_start_, counted_);
    return seconds_;
  }

 private:
  CudaStream& stream_;
  CudaConvexFrame frame_;
  std::size_t entries_ = 0;
  RasterSeconds seconds_;
  Event start_, projected_, listed_, blended_, backward_start_, blended_backward_, projected_backward_, count_start_,
      counted_;
};

}  // namespace

std::unique_ptr<ConvexBackend> make_convex_rasterizer(CudaStream& stream) {
  return std::make_unique<CudaConvexRasterizer>(stream);
}

}  // namespace splatboost::cuda
