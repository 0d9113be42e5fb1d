// SPDX-License-Identifier: Apache-2.0
#include "program/bench/cuda_bench.h"

#include <cuda_runtime.h>

#include <chrono>
#include <cstdint>
#include <optional>
#include <span>

#include "device/cuda_event.h"
#include "splatboost/activations.h"
#include "splatboost/adam.h"
#include "splatboost/device_array.h"
#include "splatboost/multi_view_scores.h"
#include "splatboost/photometric.h"
#include "splatboost/rasterizer.h"

namespace splatboost::program {
namespace {

constexpr float kLambdaDssim = 0.2f;

/// A trained parameter. Its learning rate is nearly zero, so that every repeat sees the same scene.
struct Parameter {
  DeviceArray<float> values, gradients, first, second;

  Parameter(CudaStream& stream, std::span<const float> initial)
      : values(stream, initial), gradients(stream), first(stream), second(stream) {
    for (DeviceArray<float>* array : {&gradients, &first, &second}) {
      array->ensure(initial.size());
      array->fill_zero();
    }
  }
  void step(std::int64_t number) {
    AdamOptions options;
    options.learning_rate = 1e-20f;
    adam_step(values.span(), gradients.span(), first.span(), second.span(), number, options, values.stream());
  }
};

/// The scene on the device, and the calls of an iteration.
class CudaIteration final : private RasterizerHook {
 public:
  CudaIteration(const BenchScene& bench, CudaStream& stream)
      : stream_(stream),
        view_(bench.scene.train[0]),
        truth_(stream, std::span<const std::uint8_t>(view_.color)),
        means_(stream, bench.cloud.means),
        log_scales_(stream, bench.cloud.log_scales),
        rotations_(stream, bench.cloud.rotations),
        logit_opacities_(stream, bench.cloud.logit_opacities),
        sh_dc_(stream, bench.cloud.sh_dc),
        sh_rest_(stream, bench.cloud.sh_rest),
        rasterizer_(stream),
        photometric_(stream),
        scorer_(stream) {
    gaussians_ = bench.gaussians();
    for (DeviceArray<float>* of_gaussians : {&screen_, &screen_abs_}) of_gaussians->ensure(2 * gaussians_.count);
    scales_.ensure(3 * gaussians_.count);
    opacities_.ensure(gaussians_.count);
    image_.ensure(view_.color.size());
    image_gradient_.ensure(view_.color.size());
    gaussians_.means = means_.values.span();
    gaussians_.scales = scales_.span();
    gaussians_.rotations = rotations_.values.span();
    gaussians_.opacities = opacities_.span();
    gaussians_.sh_dc = sh_dc_.values.span();
    gaussians_.sh_rest = sh_rest_.values.span();
  }

  void activate() {
    exponentials(log_scales_.values.span(), scales_.span(), stream_);
    sigmoids(logit_opacities_.values.span(), opacities_.span(), stream_);
  }
  void forward() {
    RasterOptions options;
    options.box = BoxPolicy::ellipse;
    RasterImages images;
    images.color = image_.span();
    rasterizer_.forward(view_.camera, gaussians_, options, images);
  }
  void loss() { photometric_.evaluate_ahead(image_.span(), truth(), kLambdaDssim, image_gradient_.span()); }
  void backward() {
    RasterImageGradients of_images;
    of_images.color = image_gradient_.span();
    GaussianGradients gradients;
    gradients.mode = GradientMode::accumulate;
    gradients.means = means_.gradients.span();
    gradients.scales = log_scales_.gradients.span();
    gradients.rotations = rotations_.gradients.span();
    gradients.opacities = logit_opacities_.gradients.span();
    gradients.sh_dc = sh_dc_.gradients.span();
    gradients.sh_rest = sh_rest_.gradients.span();
    gradients.screen_means = screen_.span();
    gradients.screen_means_abs = screen_abs_.span();
    rasterizer_.backward(gaussians_, of_images, gradients);
  }
  void optimize() {
    ++step_;
    for (Parameter* parameter : {&means_, &log_scales_, &rotations_, &logit_opacities_, &sh_dc_, &sh_rest_}) {
      parameter->step(step_);
    }
  }
  void all() {
    activate();
    forward();
    loss();
    backward();
    optimize();
  }
  void score() { scorer_.score(*this, {.views = 1}, RandomStream(0, 0, RandomPurpose::scored_views)); }

  /// Waits for the device.
  const RasterSeconds& raster_seconds() const { return rasterizer_.seconds(); }

 private:
  TruthImage truth() const { return {view_.camera.width, view_.camera.height, truth_.span(), {}}; }

  void set_beta(std::optional<float>) override {}
  std::size_t primitives() const override { return gaussians_.count; }
  std::size_t scorable_views() const override { return 1; }
  ScoredView render_for_score(std::size_t) override {
    forward();
    rasterizer_.settle();
    return {image_.span(), truth()};
  }
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    rasterizer_.count_flagged(flagged, counts);
  }

  CudaStream& stream_;
  const View& view_;
  DeviceArray<std::uint8_t> truth_;
  Parameter means_, log_scales_, rotations_, logit_opacities_, sh_dc_, sh_rest_;
  DeviceArray<float> scales_{stream_}, opacities_{stream_};
  DeviceArray<float> image_{stream_}, image_gradient_{stream_}, screen_{stream_}, screen_abs_{stream_};
  Gaussians gaussians_;
  Rasterizer rasterizer_;
  Photometric photometric_;
  MultiViewScorer scorer_;
  std::int64_t step_ = 0;
};

/// Measures the time between two events in the stream.
class DeviceClock {
 public:
  explicit DeviceClock(CudaStream& stream) : begin_(stream, cudaEventDefault), end_(stream, cudaEventDefault) {}

  /// Milliseconds of a call on the device. The call is made twice and the second one is timed: the host submits it
  /// while the device still works on the first, so that no launch latency is included.
  template <class Call>
  double milliseconds(const Call& call) {
    call();
    begin_.record();
    call();
    end_.record();
    end_.wait();
    return 1e3 * seconds_between(begin_, end_);
  }

 private:
  cuda::Event begin_, end_;
};

/// Times each stage once.
std::map<std::string, double> time_stages(CudaIteration& iteration, DeviceClock& clock) {
  std::map<std::string, double> milliseconds;
  milliseconds["activate"] = clock.milliseconds([&] { iteration.activate(); });
  clock.milliseconds([&] { iteration.forward(); });
  const RasterSeconds forward = iteration.raster_seconds();
  milliseconds["project"] = 1e3 * forward.project;
  milliseconds["tile_lists"] = 1e3 * forward.tile_lists;
  milliseconds["blend"] = 1e3 * forward.blend;
  milliseconds["loss"] = clock.milliseconds([&] { iteration.loss(); });
  clock.milliseconds([&] { iteration.backward(); });
  const RasterSeconds backward = iteration.raster_seconds();
  milliseconds["blend_backward"] = 1e3 * backward.blend_backward;
  milliseconds["project_backward"] = 1e3 * backward.project_backward;
  milliseconds["optimizer"] = clock.milliseconds([&] { iteration.optimize(); });
  milliseconds["iteration"] = clock.milliseconds([&] { iteration.all(); });
  return milliseconds;
}

double time_scoring(CudaIteration& iteration) {
  const auto start = std::chrono::steady_clock::now();
  iteration.score();
  return 1e3 * std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

CudaSamples measure_cuda_stages(const BenchScene& bench, CudaStream& stream, int warm_up, int repeats) {
  CudaSamples samples;
  CudaIteration iteration(bench, stream);
  DeviceClock clock(stream);
  for (int i = 0; i < warm_up + repeats; ++i) {
    auto milliseconds = time_stages(iteration, clock);
    milliseconds["scoring"] = time_scoring(iteration);
    milliseconds["count"] = 1e3 * iteration.raster_seconds().count;
    if (i < warm_up) continue;
    for (const auto& [stage, value] : milliseconds) samples[stage].push_back(value);
  }
  return samples;
}

}  // namespace splatboost::program
