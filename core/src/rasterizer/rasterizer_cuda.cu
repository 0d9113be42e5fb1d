// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <optional>

#include "device/cuda_event.h"
#include "projection/cuda_frame.h"
#include "rasterizer/cuda_ops.h"
#include "rasterizer/cuda_raster_clock.h"
#include "splatboost/errors.h"

namespace splatboost::cuda {
namespace {

/// Buffers are sized to this multiple of the largest number of elements that any frame needed ...
constexpr double kRoomFactor = 1.5;
/// ... once their size is below this multiple of it.
constexpr double kMinRoomFactor = 1.25;
constexpr double kMinRoom = 1024;

/// Copies a frame's totals to pinned host memory while the host goes on.
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
  explicit CudaRasterizer(CudaStream& stream) : stream_(stream), frame_(stream), totals_(stream), clock_(stream) {
    frame_.totals.ensure(1);
    frame_.totals.fill_zero();
  }

  void forward(const Camera& camera, const Gaussians& gaussians, const RasterOptions& options,
               const RasterImages& images) override {
    if (on_the_way_ && totals_.is_there()) {
      on_the_way_ = false;
      learn();
    }
    frame_.camera = camera;
    frame_.options = options;
    frame_.projection = make_projection_camera(camera);
    frame_.gaussians = gaussians.count;
    frame_.color = !images.color.empty();
    frame_.features = images.features.empty() ? 0 : gaussians.features_per_gaussian;
    frame_.inverse_depth = !images.inverse_depth.empty();
    frame_.tiles_x = camera.tiles_x();
    frame_.tiles_y = camera.tiles_y();
    gaussians_ = gaussians;
    images_ = images;
    // Waits in the first frame, in one of more tiles than all before, and after one that outgrew its room or failed.
    const bool larger = frame_.tiles() > most_tiles_;
    most_tiles_ = std::max(most_tiles_, frame_.tiles());
    draw(half_drawn_ || outgrown_ || known_gaussians_ == 0 || larger);
  }

  void backward(const Gaussians& gaussians, const RasterImageGradients& image_gradients,
                const GaussianGradients& gradients) override {
    check_drawn();
    SPLATBOOST_CHECK(gradients.sh_factors.empty(), "sh_factors are available on the CPU only");
    clock_.backward_start.record();
    blend_backward(frame_, image_gradients, !gradients.screen_means_abs.empty(), stream_);
    clock_.blended_backward.record();
    project_backward(frame_, gaussians, gradients, stream_);
    clock_.projected_backward.record();
  }

  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    check_drawn();
    clock_.count_start.record();
    count_flagged_pixels(frame_, flagged, counts, stream_);
    clock_.counted.record();
  }

  void add_weights(std::span<std::int32_t> weights) override {
    check_drawn();
    clock_.count_start.record();
    add_blending_weights(frame_, weights, stream_);
    clock_.counted.record();
  }

  void count_observed(float min_transmittance, std::span<std::int32_t> counts) override {
    check_drawn();
    clock_.count_start.record();
    count_observed_pixels(frame_, min_transmittance, counts, stream_);
    clock_.counted.record();
  }

  bool settle() override {
    if (settled_) return false;
    if (!half_drawn_) {
      wait_and_learn();
      settled_ = known_.visible <= frame_.visible_room && known_.entries <= frame_.entry_room;
      if (settled_) return false;
    }
    draw(true);
    return true;
  }

  std::span<const std::uint8_t> visible() const override { return frame_.visible.span(); }
  std::span<const std::int32_t> screen_radii() const override { return frame_.radii.span(); }

  RasterCounts counts() override {
    if (!settle()) wait_and_learn();  // known_ may be of an earlier frame
    return {known_.visible, known_.entries};
  }

  const RasterSeconds& seconds() override { return seconds_ = clock_.seconds(); }

 private:
  /// Draws the frame. @param exactly waits for the frame's totals and makes room for them; otherwise makes room based
  /// on the totals of earlier frames. If it throws, the next frame makes room as if it were the first.
  void draw(bool exactly) {
    if (half_drawn_) forget();
    settled_ = false;
    half_drawn_ = true;
    run_stages(exactly);
    half_drawn_ = false;
    settled_ = exactly;
  }

  void run_stages(bool exactly) {
    clock_.start.record();
    project(frame_, gaussians_, stream_);
    clock_.projected.record();
    count_visible(frame_, stream_);
    if (exactly) wait_for(frame_.places, frame_.gaussians, known_.visible, known_.most_visible);
    make_room(visible_room_, known_.most_visible);
    frame_.visible_room = std::min(visible_room_, frame_.gaussians);
    sort_by_depth(frame_, stream_);
    if (exactly) wait_for(frame_.entry_offsets, frame_.visible_room, known_.entries, known_.most_entries);
    make_room(frame_.entry_room, known_.most_entries);
    if (exactly) outgrown_ = on_the_way_ = false;
    build_tile_lists(frame_, stream_);
    if (!exactly && !on_the_way_) {
      totals_.fetch(frame_.totals);
      on_the_way_ = true;
    }
    clock_.listed.record();
    blend(frame_, images_, stream_);
    clock_.blended.record();
  }

  /// Forgets the totals of all frames: one of them may be too large for the device.
  void forget() {
    frame_.totals.fill_zero();
    known_ = {};
    visible_room_ = frame_.visible_room = frame_.entry_room = 0;
    known_gaussians_ = 0;
    on_the_way_ = false;
  }

  void check_drawn() const {
    SPLATBOOST_CHECK(!half_drawn_, "the last view could not be drawn: settle() or forward() must succeed first");
  }

  void make_room(std::size_t& room, std::uint32_t most) const {
    const double growth = std::max(1.0, static_cast<double>(frame_.gaussians) / static_cast<double>(known_gaussians_));
    const double needed = growth * static_cast<double>(most);
    if (kMinRoomFactor * needed + kMinRoom <= static_cast<double>(room)) return;
    room = static_cast<std::size_t>(kRoomFactor * needed + kMinRoom);
    if (most <= kMaxRoom) room = std::min(room, kMaxRoom);  // more is refused by build_tile_lists
  }

  /// Reads the totals that have arrived.
  void learn() {
    known_ = totals_.get();
    known_gaussians_ = std::max({known_gaussians_, frame_.gaussians, std::size_t{1}});
    outgrown_ = known_.most_visible > visible_room_ || known_.most_entries > frame_.entry_room;
  }

  /// Reads one total of the frame, the last of some offsets.
  void wait_for(const DeviceArray<std::uint32_t>& offsets, std::size_t last, std::uint32_t& known,
                std::uint32_t& most) {
    stream_.copy_to_host(&known, offsets.data() + last, sizeof known);
    most = std::max(most, known);
    known_gaussians_ = std::max({known_gaussians_, frame_.gaussians, std::size_t{1}});
  }

  void wait_and_learn() {
    totals_.fetch(frame_.totals);
    totals_.wait();
    on_the_way_ = false;
    learn();
  }

  CudaStream& stream_;
  CudaFrame frame_;
  Gaussians gaussians_;  ///< of the last frame, which may have to be drawn again
  RasterImages images_;
  TotalsOnHost totals_;
  std::size_t visible_room_ = 0;  ///< frame_.visible_room is this, but at most N
  bool on_the_way_ = false;       ///< totals of some frame are being copied
  bool settled_ = true;           ///< the last frame is known to have had enough room
  bool half_drawn_ = false;       ///< drawing the last frame threw
  bool outgrown_ = false;         ///< a frame was found to have had too little room
  FrameTotals known_{};
  std::size_t known_gaussians_ = 0;  ///< largest N at which totals were read; 0: none were yet
  std::size_t most_tiles_ = 0;       ///< of a frame: a larger image may have more entries than there is room for
  RasterSeconds seconds_;
  RasterClock clock_;
};

}  // namespace

std::unique_ptr<RasterizerBackend> make_rasterizer(CudaStream& stream) {
  return std::make_unique<CudaRasterizer>(stream);
}

}  // namespace splatboost::cuda
