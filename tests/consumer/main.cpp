// SPDX-License-Identifier: Apache-2.0
// Renders one Gaussian forward and backward with the installed core, and asks the installed adapter for its box.
#include <splatboost/rasterizer.h>
#include <vanilla/vanilla_adapter.h>

#include <cmath>
#include <cstdio>
#include <vector>

int main() {
  splatboost::Threads threads(2);
  splatboost::Camera camera;
  camera.width = 32;
  camera.height = 32;
  camera.fx = camera.fy = 32;
  camera.cx = camera.cy = 16;

  const std::vector<float> means = {0, 0, 2};
  const std::vector<float> scales = {0.1f, 0.1f, 0.1f};
  const std::vector<float> rotations = {1, 0, 0, 0};
  const std::vector<float> opacities = {0.8f};
  const std::vector<float> colors = {1, 0.5f, 0.25f};
  splatboost::Gaussians gaussians;
  gaussians.count = 1;
  gaussians.means = means;
  gaussians.scales = scales;
  gaussians.rotations = rotations;
  gaussians.opacities = opacities;
  gaussians.colors = colors;

  const splatboost::VanillaAdapter adapter(splatboost::VanillaBoost{}, threads);
  splatboost::RasterOptions options;
  options.box = splatboost::BoxPolicy::ellipse;
  options.beta = adapter.beta().value();

  std::vector<float> image(3 * 32 * 32);
  splatboost::Rasterizer rasterizer(threads);
  splatboost::RasterImages images;
  images.color = image;
  rasterizer.forward(camera, gaussians, options, images);
  const float middle = image[16 * 32 + 16];

  const std::vector<float> image_gradient(image.size(), 1.0f);
  std::vector<float> opacity_gradient(1);
  splatboost::RasterImageGradients image_gradients;
  image_gradients.color = image_gradient;
  splatboost::GaussianGradients gradients;
  gradients.opacities = opacity_gradient;
  rasterizer.backward(gaussians, image_gradients, gradients);

  std::printf("middle pixel %.3f, d sum / d opacity %.3f\n", middle, opacity_gradient[0]);
  // The pixel is half a pixel off the centre of a splat of opacity 0.8; all its pixels increase with the opacity.
  const bool right = middle > 0.7f && middle <= 0.8f && std::isfinite(opacity_gradient[0]) && opacity_gradient[0] > 1;
  return right ? 0 : 1;
}
