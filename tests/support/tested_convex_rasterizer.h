// SPDX-License-Identifier: Apache-2.0
/// @file The rasterizer of convexes that its tests use on every device; see support/tested_rasterizer.h.
#pragma once

#include "splatboost/convex_rasterizer.h"
#include "support/tested_rasterizer.h"

#ifdef SPLATBOOST_TEST_ON_CUDA

namespace splatboost::test {

class ConvexRasterizer {
 public:
  explicit ConvexRasterizer(const Threads&) : rasterizer_(test_stream()) {}

  void forward(const Camera& camera, const Convexes& convexes, const ConvexOptions& options, std::span<float> color,
               std::span<float> alpha = {}) {
    convexes_ = convexes;
    convexes_.points = points_.there(convexes.points);
    convexes_.smoothness = smoothness_.there(convexes.smoothness);
    convexes_.sharpness = sharpness_.there(convexes.sharpness);
    convexes_.opacities = opacities_.there(convexes.opacities);
    convexes_.sh_dc = sh_dc_.there(convexes.sh_dc);
    convexes_.sh_rest = sh_rest_.there(convexes.sh_rest);
    convexes_.colors = colors_.there(convexes.colors);
    Carried<float> image, opacity;
    rasterizer_.forward(camera, convexes_, options, image.there_and_back(color), opacity.there_and_back(alpha));
    rasterizer_.settle();
    image.back();
    opacity.back();
  }

  void backward(const Convexes& convexes, std::span<const float> color, std::span<const float> alpha,
                const ConvexGradients& gradients) {
    EXPECT_EQ(convexes.count, convexes_.count);
    Carried<float> image, opacity;
    Carried<float> out[10];
    rasterizer_.backward(
        convexes_, image.there(color), opacity.there(alpha),
        {gradients.mode, out[0].there_and_back(gradients.points), out[1].there_and_back(gradients.smoothness),
         out[2].there_and_back(gradients.sharpness), out[3].there_and_back(gradients.opacities),
         out[4].there_and_back(gradients.sh_dc), out[5].there_and_back(gradients.sh_rest),
         out[6].there_and_back(gradients.colors), out[7].there_and_back(gradients.view_sharpness),
         out[8].there_and_back(gradients.view_sharpness_abs), out[9].there_and_back(gradients.screen_points)});
    for (Carried<float>& rows : out) rows.back();
  }

  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) {
    Carried<std::uint8_t> mask;
    Carried<std::int32_t> sums;
    rasterizer_.count_flagged(mask.there(flagged), sums.there_and_back(counts));
    sums.back();
  }

  void add_weights(std::span<std::int32_t> weights) {
    Carried<std::int32_t> sums;
    rasterizer_.add_weights(sums.there_and_back(weights));
    sums.back();
  }

  const std::vector<std::uint8_t>& visible() {
    const std::span<const std::uint8_t> there = rasterizer_.visible();
    visible_.resize(there.size());
    test_stream().copy_to_host(visible_.data(), there.data(), there.size_bytes());
    return visible_;
  }
  ConvexCounts counts() const { return rasterizer_.counts(); }

 private:
  splatboost::ConvexRasterizer rasterizer_;
  Convexes convexes_;
  Carried<float> points_, smoothness_, sharpness_, opacities_, sh_dc_, sh_rest_, colors_;
  std::vector<std::uint8_t> visible_;
};

}  // namespace splatboost::test

#endif
