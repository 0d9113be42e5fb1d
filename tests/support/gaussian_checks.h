// SPDX-License-Identifier: Apache-2.0
/// @file Checks that every backbone of explicit Gaussians must pass.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "splatboost/photometric.h"
#include "splatboost/rasterizer.h"
#include "support/backbone_checks.h"
#include "trainer/dataset/splat_ply.h"
#include "trainer/evaluation/evaluate.h"

namespace splatboost::testing {

inline SplatCloud exported(const Backbone& backbone) {
  const test::TemporaryFolder folder;
  backbone.export_model(folder.path());
  return read_splat_ply(folder / "point_cloud.ply");
}

inline void import_cloud(Backbone& backbone, const SplatCloud& cloud) {
  const test::TemporaryFolder folder;
  write_splat_ply(folder / "point_cloud.ply", cloud);
  backbone.import_model(folder.path());
}

class NeverSteps : public OptimizerHook {
 public:
  bool steps_at(std::string_view, Moment) const override { return false; }
};

class StepsEveryThird : public OptimizerHook {
 public:
  bool steps_at(std::string_view, Moment moment) const override { return moment.iteration % 3 == 0; }
};

/// Gradients with respect to activated Gaussians.
struct CloudGradients {
  double loss = 0;
  std::vector<float> means, scales, rotations, opacities;
};

/// The gradients that a training iteration of the backbone accumulates at these parameters.
inline CloudGradients gathered_gradients(Backbone& backbone, const SplatCloud& cloud, int iteration, const View& view) {
  NeverSteps never;
  import_cloud(backbone, cloud);
  backbone.set_hooks(nullptr, &never);
  CloudGradients gradients;
  gradients.loss = backbone.train_step(iteration, view);
  const test::TemporaryFolder folder;
  save_state(backbone, folder / "state");
  const ArchiveReader state(folder / "state");
  gradients.means = state.floats("xyz.gradients");
  gradients.scales = state.floats("scaling.gradients");
  gradients.rotations = state.floats("rotation.gradients");
  gradients.opacities = state.floats("opacity.gradients");
  return gradients;
}

/// The gradients of a view drawn by the rasterizer (which has its own tests) with these scales and opacities and
/// spherical harmonics of degree 0; the loss is l1_weight·L1 + ssim_weight·(1 − SSIM).
inline CloudGradients gradients_of_view(const SplatCloud& cloud, std::span<const float> scales,
                                        std::span<const float> opacities, const View& view,
                                        const RasterOptions& options, float l1_weight, float ssim_weight,
                                        const Threads& threads) {
  Gaussians gaussians;
  gaussians.count = cloud.size();
  gaussians.means = cloud.means;
  gaussians.scales = scales;
  gaussians.rotations = cloud.rotations;
  gaussians.opacities = opacities;
  gaussians.sh_dc = cloud.sh_dc;
  Rasterizer rasterizer(threads);
  std::vector<float> image(view.color.size()), of_l1(image.size()), of_ssim(image.size());
  RasterImages images;
  images.color = image;
  rasterizer.forward(view.camera, gaussians, options, images);
  Photometric photometric(threads);
  CloudGradients out;
  out.loss = l1_weight * photometric.evaluate(image, view.truth(), 0, of_l1).total;
  out.loss += ssim_weight * photometric.evaluate(image, view.truth(), 1, of_ssim).total;
  for (std::size_t p = 0; p < image.size(); ++p) of_l1[p] = l1_weight * of_l1[p] + ssim_weight * of_ssim[p];
  out.means.resize(cloud.means.size());
  out.scales.resize(scales.size());
  out.rotations.resize(cloud.rotations.size());
  out.opacities.resize(opacities.size());
  RasterImageGradients image_gradients;
  image_gradients.color = of_l1;
  GaussianGradients gradients;
  gradients.means = out.means;
  gradients.scales = out.scales;
  gradients.rotations = out.rotations;
  gradients.opacities = out.opacities;
  rasterizer.backward(gaussians, image_gradients, gradients);
  return out;
}

/// Expects equality up to `tolerance` times the largest expected magnitude.
inline void expect_close(const std::vector<float>& found, const std::vector<double>& expected, double tolerance) {
  ASSERT_EQ(found.size(), expected.size());
  double largest = 0;
  for (const double value : expected) largest = std::max(largest, std::abs(value));
  EXPECT_GT(largest, 0);
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_NEAR(static_cast<double>(found[i]), expected[i], tolerance * largest) << "row " << i;
  }
}

}  // namespace splatboost::testing
