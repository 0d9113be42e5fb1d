// SPDX-License-Identifier: Apache-2.0
/// @file One training iteration and one scored view on a fixed scene, as separate public calls of the core, for timing
/// kernels and counting their instructions.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "splatboost/adam.h"
#include "splatboost/error_map.h"
#include "splatboost/photometric.h"
#include "splatboost/rasterizer.h"
#include "trainer/synth/bench_scene.h"

namespace splatboost::test {

/// Memory and arguments of the calls. The compact box is on, as in accelerated training. Every call reads the results
/// of those before it: call all of them once, in the order of this class, before timing any.
class Workload {
 public:
  Workload(const BenchSize& size, const Threads& threads)
      : bench_(make_bench_scene(size)),
        gaussians_(bench_.gaussians()),
        threads_(threads),
        rasterizer_(threads),
        photometric_(threads) {
    options_.box = BoxPolicy::ellipse;

    const std::size_t n = bench_.cloud.size(), pixels = bench_.scene.train[0].color.size() / 3;
    image_.resize(3 * pixels);
    image_gradient_.resize(3 * pixels);
    error_.resize(pixels);
    flagged_.resize(pixels);
    counts_.resize(n);
    for (Tensor* tensor : {&means_, &scale_, &rotation_, &opacity_, &dc_, &rest_}) {
      for (auto* values : {&tensor->gradients, &tensor->values, &tensor->first, &tensor->second}) {
        values->resize(tensor->width * n);
      }
    }
  }

  const RasterSeconds& seconds() const { return rasterizer_.seconds(); }

  /// Projection, tile lists, blending.
  void forward() {
    RasterImages images;
    images.color = image_;
    rasterizer_.forward(bench_.scene.train[0].camera, gaussians_, options_, images);
  }
  void loss() { photometric_.evaluate(image_, bench_.scene.train[0].truth(), 0.2f, image_gradient_); }
  /// Gradient of blending, then of projection; the gradients accumulate.
  void backward() {
    RasterImageGradients of_images;
    of_images.color = image_gradient_;
    GaussianGradients gradients;
    gradients.mode = GradientMode::accumulate;
    gradients.means = means_.gradients;
    gradients.scales = scale_.gradients;
    gradients.rotations = rotation_.gradients;
    gradients.opacities = opacity_.gradients;
    gradients.sh_dc = dc_.gradients;
    gradients.sh_rest = rest_.gradients;
    rasterizer_.backward(gaussians_, of_images, gradients);
  }
  /// One step of all parameters. It updates separate tensors, so that every iteration draws the same scene.
  void adam() {
    ++step_;
    for (Tensor* tensor : {&means_, &scale_, &rotation_, &opacity_, &dc_, &rest_}) {
      adam_step(tensor->values, tensor->gradients, tensor->first, tensor->second, step_, {}, threads_);
    }
  }
  /// New gradients for adam(), which zeroes them: without, the moments would decay to denormal numbers, which are slow.
  void refill_gradients() {
    for (Tensor* tensor : {&means_, &scale_, &rotation_, &opacity_, &dc_, &rest_}) {
      std::fill(tensor->gradients.begin(), tensor->gradients.end(), 1e-3f);
    }
  }
  void flag() { flag_errors(image_, bench_.scene.train[0].truth(), 0.1f, error_, flagged_, threads_); }
  /// Replay of the tile lists for the flagged pixels.
  void count() { rasterizer_.count_flagged(flagged_, counts_); }

  void iteration() {
    forward();
    loss();
    backward();
    adam();
    flag();
    count();
  }

 private:
  struct Tensor {
    std::size_t width;
    std::vector<float> gradients, values, first, second;
    explicit Tensor(std::size_t row) : width(row) {}
  };

  BenchScene bench_;
  Gaussians gaussians_;
  Threads threads_;
  Rasterizer rasterizer_;
  Photometric photometric_;
  RasterOptions options_;
  std::vector<float> image_, image_gradient_, error_;
  std::vector<std::uint8_t> flagged_;
  std::vector<std::int32_t> counts_;
  Tensor means_{3}, scale_{3}, rotation_{4}, opacity_{1}, dc_{3}, rest_{45};
  std::int64_t step_ = 0;
};

}  // namespace splatboost::test
