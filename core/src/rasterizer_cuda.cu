// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <optional>

#include "cuda_event.h"
#include "cuda_frame.h"
#include "cuda_operations.h"

namespace splatboost::cuda {
namespace {

/// By how much a frame may outgrow those before it: room is made for that many times their largest.
constexpr double kRoomFactor = 1.5;
constexpr std::size_t kLeastRoom = 1024;

/// The last frame's numbers, which the device writes while the host goes on.
class TotalsOnHost {
 public:
  explicit TotalsOnHost(CudaStream& stream)
      : stream_(stream),
        totals_(static_cast<FrameTotals*>(stream.allocate_pinned(sizeof(FrameTotals)))),
        arrived_(stream, cudaEventDisableTiming) {}
  ~TotalsOnHost() { stream_.release_pinned(totals_); }
  TotalsOnHost(const TotalsOnHost&) = delete;
  TotalsOnHost& operator=(const TotalsOnHost&) = delete;

  void fetch(const DeviceArray<FrameTotals>& totals) {
    stream_.copy_to_pinned(totals_, totals.data(), sizeof(FrameTotals));
    arrived_.record();
  }
  bool is_there() const { return arrived_.is_done(); }
  void wait() { arrived_.wait(); }
  FrameTotals get() const { return *totals_; }

 private:
  CudaStream& stream_;
  FrameTotals* totals_;
  Event arrived_;
};

class CudaRasterizer : public RasterizerBackend {
 public:
  explicit CudaRasterizer(CudaStream& stream)
      : stream_(stream),
        frame_(stream),
        totals_(stream),
        start_(stream, cudaEventDefault),
        projected_(stream, cudaEventDefault),
        listed_(stream, cudaEventDefault),
        blended_(stream, cudaEventDefault),
        backward_start_(stream, cudaEventDefault),
        blended_backward_(stream, cudaEventDefault),
        projected_backward_(stream, cudaEventDefault),
        count_start_(stream, cudaEventDefault),
        counted_(stream, cudaEventDefault) {}

  void forward(const Camera& camera, const Gaussians& gaussians, const RasterOptions& options,
               const RasterImages& images) override {
    if (pending_ && totals_.is_there()) learn();
    frame_.camera = camera;
    frame_.options = options;
    frame_.projection = make_projection_camera(camera);
    frame_.gaussians = gaussians.count;
    frame_.features = images.features.empty() ? 0 : gaussians.features_per_gaussian;
    frame_.inverse_depth = !images.inverse_depth.empty();
    frame_.tiles_x = camera.tiles_x();
    frame_.tiles_y = camera.tiles_y();
    gaussians_ = gaussians;
    images_ = images;
    draw(outgrown_ || most_entries_ == 0);
  }

  void backward(const Gaussians& gaussians, const RasterImageGradients& image_gradients,
                const GaussianGradients& gradients) override {
    backward_start_.record();
    blend_backward(frame_, image_gradients, !gradients.screen_means_abs.empty(), stream_);
    blended_backward_.record();
    project_backward(frame_, gaussians, gradients, stream_);
    projected_backward_.record();
  }

  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    count_start_.record();
    count_flagged_pixels(frame_, flagged, counts, stream_);
    counted_.record();
  }

  bool settle() override {
    if (!pending_) return false;
    totals_.wait();
    if (!learn()) return false;
    draw(true);
    return true;
  }

  std::span<const std::uint8_t> visible() const override { return frame_.visible.span(); }
  std::span<const std::int32_t> screen_radii() const override { return frame_.radii.span(); }

  RasterCounts counts() override {
    settle();
    return {known_.visible, known_.entries};
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
  /// Draws the frame. @param exactly waits for its numbers and makes room for them; otherwise it makes room by those
  /// of frames before.
  void draw(bool exactly) {
    start_.record();
    project(frame_, gaussians_, stream_);
    projected_.record();
    count_visible(frame_, stream_);
    if (exactly) {
      totals_.fetch(frame_.totals);
      totals_.wait();
      frame_.visible_room = totals_.get().visible;
    } else {
      frame_.visible_room = std::min(frame_.gaussians, room_for(most_visible_));
    }
    sort_by_depth(frame_, stream_);
    totals_.fetch(frame_.totals);
    if (exactly) {
      totals_.wait();
      frame_.entry_room = totals_.get().entries;
      known_ = totals_.get();
      note(known_);
      pending_ = outgrown_ = false;
    } else {
      frame_.entry_room = room_for(most_entries_);
      pending_ = true;
    }
    build_tile_lists(frame_, stream_);
    listed_.record();
    blend(frame_, images_, stream_);
    blended_.record();
  }

  std::size_t room_for(std::size_t most) const {
    const double growth = std::max(1.0, static_cast<double>(frame_.gaussians) / static_cast<double>(noted_gaussians_));
    return static_cast<std::size_t>(kRoomFactor * growth * static_cast<double>(most)) + kLeastRoom;
  }

  /// Looks at the last frame's numbers, which have arrived. @return whether there was too little room for it
  bool learn() {
    pending_ = false;
    known_ = totals_.get();
    note(known_);
    outgrown_ = known_.visible > frame_.visible_room || known_.entries > frame_.entry_room;
    return outgrown_;
  }

  void note(const FrameTotals& totals) {
    most_visible_ = std::max<std::size_t>(most_visible_, totals.visible);
    most_entries_ = std::max<std::size_t>({most_entries_, totals.entries, 1});
    noted_gaussians_ = std::max<std::size_t>(frame_.gaussians, 1);
  }

  CudaStream& stream_;
  CudaFrame frame_;
  Gaussians gaussians_;  ///< of the last frame, which may have to be drawn again
  RasterImages images_;
  TotalsOnHost totals_;
  bool pending_ = false;  ///< the last frame's numbers have not been looked at
  FrameTotals known_{};
  bool outgrown_ = false;                            ///< a frame was found to have had too little room
  std::size_t most_visible_ = 0, most_entries_ = 0;  ///< of all frames so far; no entries: no frame was drawn
  std::size_t noted_gaussians_ = 1;                  ///< N of the frame that was noted last
  RasterSeconds seconds_;
  Event start_, projected_, listed_, blended_, backward_start_, blended_backward_, projected_backward_, count_start_,
      counted_;
};

}  // namespace

std::unique_ptr<RasterizerBackend> make_rasterizer(CudaStream& stream) {
  return std::make_unique<CudaRasterizer>(stream);
}

}  // namespace splatboost::cuda
