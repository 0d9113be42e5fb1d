// SPDX-License-Identifier: Apache-2.0
// Checks of the reference implementation: known answers, and dual numbers against finite differences.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "reference/dual.h"
#include "reference/photometric.h"
#include "reference/rasterizer.h"
#include "reference/training.h"

namespace splatboost::reference {
namespace {

struct Numbers {
  std::mt19937_64 engine;
  explicit Numbers(std::uint64_t seed) : engine(seed) {}
  double operator()(double low, double high) {
    return low + (high - low) * (static_cast<double>(engine() >> 11) * 0x1.0p-53);
  }
};

Camera small_camera() {
  Camera camera;
  camera.width = 37;
  camera.height = 21;
  camera.fx = 30;
  camera.fy = 33;
  camera.cx = 20.25;
  camera.cy = 9.5;
  const double angle = 0.3;
  camera.rotation = {{{std::cos(angle), 0, std::sin(angle)}, {0, 1, 0}, {-std::sin(angle), 0, std::cos(angle)}}};
  camera.translation = {0.1, -0.2, 4};
  return camera;
}

Scene<double> random_scene(std::size_t count, std::uint64_t seed) {
  Numbers random(seed);
  Scene<double> scene;
  scene.count = count;
  scene.sh_degree = 3;
  scene.sh_rest_rows = 15;
  scene.features_per_gaussian = 2;
  for (std::size_t i = 0; i < count; ++i) {
    for (int axis = 0; axis < 3; ++axis) scene.means.push_back(random(-1.5, 1.5));
    for (int axis = 0; axis < 3; ++axis) scene.scales.push_back(random(0.05, 0.4));
    for (int k = 0; k < 4; ++k) scene.rotations.push_back(random(-1, 1));
    scene.opacities.push_back(random(0.2, 0.9));
    for (int c = 0; c < 3; ++c) scene.sh_dc.push_back(random(-1, 2));
    for (int k = 0; k < 45; ++k) scene.sh_rest.push_back(random(-0.3, 0.3));
    for (int f = 0; f < 2; ++f) scene.features.push_back(random(-1, 1));
  }
  scene.screen_means.assign(2 * count, 0);
  return scene;
}

TEST(Dual, FollowsTheRulesOfCalculus) {
  const auto x = Dual<2>::variable(0.7, 0);
  const auto y = Dual<2>::variable(1.9, 1);
  const auto f = sqrt(x * y) / (1.0 + exp(-x)) - log(y) * abs(x - y);
  const double root = std::sqrt(0.7 * 1.9);
  const double s = 1 + std::exp(-0.7);
  EXPECT_NEAR(f.value, root / s - std::log(1.9) * 1.2, 1e-15);
  EXPECT_NEAR(f.slopes[0], 1.9 / (2 * root) / s + root * std::exp(-0.7) / (s * s) + std::log(1.9), 1e-14);
  EXPECT_NEAR(f.slopes[1], 0.7 / (2 * root) / s - 1.2 / 1.9 - std::log(1.9), 1e-14);
}

// An isotropic Gaussian on the optical axis: all results are known analytically.
TEST(ReferenceRasterizer, KnowsACentredSplat) {
  Camera camera;
  camera.width = camera.height = 33;
  camera.fx = camera.fy = 50;
  camera.cx = camera.cy = 16.5;
  Scene<double> scene;
  scene.count = 1;
  scene.means = {0, 0, 5};
  scene.covariances = {0.09, 0, 0, 0.09, 0, 0.09};
  scene.opacities = {0.8};
  scene.colors = {0.25, 0.5, 1};
  Options options;
  options.ellipse = true;
  options.background = {1, 0, 0};
  const auto images = render(scene, camera, options);
  const double variance = 100 * 0.09 + options.low_pass;
  const std::size_t centre = 16 * 33 + 16;
  EXPECT_NEAR(images.alpha[centre], 0.8, 1e-12);
  EXPECT_NEAR(images.color[centre], 0.8 * 0.25 + 0.2, 1e-12);
  EXPECT_NEAR(images.inverse_depth[centre], 0.8 / 5, 1e-12);
  EXPECT_NEAR(images.alpha[centre + 3], 0.8 * std::exp(-4.5 / variance), 1e-12);
  EXPECT_NEAR(images.alpha[centre - 3 * 33], 0.8 * std::exp(-4.5 / variance), 1e-12);
  EXPECT_EQ(images.radii[0], static_cast<int>(std::ceil(3 * std::sqrt(variance + std::sqrt(0.1)))));
}

TEST(ReferenceRasterizer, BlendsFrontToBackAndStopsBeforeSaturation) {
  Camera camera;
  camera.width = camera.height = 1;
  camera.fx = camera.fy = 1;
  camera.cx = camera.cy = 0.5;
  Scene<double> scene;
  scene.count = 4;
  scene.means = {0, 0, 4, 0, 0, 1, 0, 0, 2, 0, 0, 3};  // nearest first: 1 2 3 0
  scene.covariances.assign(24, 0);
  for (std::size_t i = 0; i < 4; ++i) scene.covariances[6 * i] = scene.covariances[6 * i + 3] = 1;
  scene.opacities = {0.5, 0.98, 0.98, 0.9};
  scene.colors.assign(12, 0);
  for (std::size_t i = 0; i < 4; ++i) scene.colors[3 * i] = static_cast<double>(i + 1);
  const auto images = render(scene, camera, Options{});
  // 1: T 0.02, 2: T 4e-4, 3 would take it to 4e-5: not blended, and nothing after it, though 0 alone would fit.
  EXPECT_NEAR(images.color[0], 2 * 0.98 + 3 * 0.98 * 0.02, 1e-12);
  EXPECT_NEAR(images.alpha[0], 1 - 4e-4, 1e-12);
  EXPECT_EQ(images.uncertain[0], 0);
  EXPECT_EQ(count_flagged(scene, camera, Options{}, {1}), (std::vector<std::int64_t>{0, 1, 1, 0}));
}

TEST(ReferenceRasterizer, SphericalHarmonicsAreOrthonormalOnTheSphere) {
  // One Gaussian seen from many directions. The mean of basis_j · basis_k over the sphere is δ_jk / 4π.
  Numbers random(3);
  std::vector<double> gram(16 * 16, 0);
  const int samples = 40000;
  Camera camera;
  camera.width = camera.height = 1;
  camera.fx = camera.fy = 1;
  Scene<double> scene;
  scene.count = 1;
  scene.covariances = {1, 0, 0, 1, 0, 1};
  scene.opacities = {0.5};
  scene.sh_degree = 3;
  scene.sh_rest_rows = 15;
  for (int sample = 0; sample < samples; ++sample) {
    // A lattice of equal areas (golden angle) instead of random directions: far smaller error.
    const double z = 1 - (2.0 * sample + 1) / samples;
    const double angle = sample * 2.399963229728653;
    const double ring = std::sqrt(1 - z * z);
    const double d[3] = {ring * std::cos(angle), ring * std::sin(angle), z};
    // Rotate the camera to look along d: the rows of the rotation are an orthonormal basis whose third vector is d.
    const double h[3] = {std::abs(d[2]) < 0.9 ? 0.0 : 1.0, 0, std::abs(d[2]) < 0.9 ? 1.0 : 0.0};
    std::array<double, 3> right{h[1] * d[2] - h[2] * d[1], h[2] * d[0] - h[0] * d[2], h[0] * d[1] - h[1] * d[0]};
    const double length = std::sqrt(right[0] * right[0] + right[1] * right[1] + right[2] * right[2]);
    for (double& r : right) r /= length;
    camera.rotation = {
        {{right[0], right[1], right[2]},
         {d[1] * right[2] - d[2] * right[1], d[2] * right[0] - d[0] * right[2], d[0] * right[1] - d[1] * right[0]},
         {d[0], d[1], d[2]}}};
    scene.means = {2 * d[0], 2 * d[1], 2 * d[2]};
    double basis[16];
    for (std::size_t k = 0; k < 16; ++k) {
      scene.sh_dc = {k == 0 ? 0.1 : 0, 0, 0};
      scene.sh_rest.assign(45, 0);
      if (k > 0) scene.sh_rest[(k - 1) * 3] = 0.1;
      basis[k] = (project(scene, 0, camera, Options{}).color[0] - 0.5) / 0.1;
    }
    for (std::size_t j = 0; j < 16; ++j) {
      for (std::size_t k = 0; k < 16; ++k) gram[16 * j + k] += basis[j] * basis[k] / samples;
    }
  }
  for (std::size_t j = 0; j < 16; ++j) {
    for (std::size_t k = 0; k < 16; ++k) {
      EXPECT_NEAR(gram[16 * j + k], j == k ? 0.25 / 3.14159265358979 : 0, 1e-4) << j << " " << k;
    }
  }
}

// The signs of the basis functions must be those of 3DGS, so that its published scenes render the same here.
TEST(ReferenceRasterizer, SphericalHarmonicsHaveTheFieldsSigns) {
  Camera camera;
  camera.width = camera.height = 1;
  camera.fx = camera.fy = 1;
  Scene<double> scene;
  scene.count = 1;
  scene.means = {0.6, -0.4, 2};
  scene.covariances = {1, 0, 0, 1, 0, 1};
  scene.opacities = {0.5};
  scene.sh_degree = 3;
  scene.sh_rest_rows = 15;
  const double length = std::sqrt(0.36 + 0.16 + 4);
  const double x = 0.6 / length, y = -0.4 / length, z = 2 / length;
  const double expected[16] = {0.28209479177387814,
                               -0.4886025119029199 * y,
                               0.4886025119029199 * z,
                               -0.4886025119029199 * x,
                               1.0925484305920792 * x * y,
                               -1.0925484305920792 * y * z,
                               0.31539156525252005 * (2 * z * z - x * x - y * y),
                               -1.0925484305920792 * x * z,
                               0.5462742152960396 * (x * x - y * y),
                               -0.5900435899266435 * y * (3 * x * x - y * y),
                               2.890611442640554 * x * y * z,
                               -0.4570457994644658 * y * (4 * z * z - x * x - y * y),
                               0.3731763325901154 * z * (2 * z * z - 3 * x * x - 3 * y * y),
                               -0.4570457994644658 * x * (4 * z * z - x * x - y * y),
                               1.445305721320277 * z * (x * x - y * y),
                               -0.5900435899266435 * x * (x * x - 3 * y * y)};
  for (std::size_t k = 0; k < 16; ++k) {
    scene.sh_dc = {k == 0 ? 0.1 : 0, 0, 0};
    scene.sh_rest.assign(45, 0);
    if (k > 0) scene.sh_rest[(k - 1) * 3] = 0.1;
    EXPECT_NEAR(project(scene, 0, camera, Options{}).color[0], 0.5 + 0.1 * expected[k], 1e-12) << k;
  }
}

TEST(ReferenceRasterizer, GradientsAgreeWithFiniteDifferences) {
  const Camera camera = small_camera();
  Scene<double> scene = random_scene(6, 11);
  Options options;
  options.ellipse = true;
  options.compensate_opacity = true;
  options.background = {0.2, 0.4, 0.1};
  Numbers random(5);
  const std::size_t pixels = 37 * 21;
  ImageGradients weights;
  for (std::size_t k = 0; k < 3 * pixels; ++k) weights.color.push_back(random(-1, 1));
  for (std::size_t k = 0; k < 2 * pixels; ++k) weights.features.push_back(random(-1, 1));
  for (std::size_t k = 0; k < pixels; ++k) weights.inverse_depth.push_back(random(-1, 1));
  for (std::size_t k = 0; k < pixels; ++k) weights.alpha.push_back(random(-1, 1));
  const double step = 1e-6;
  for (const Input input : {Input::means, Input::scales, Input::rotations, Input::opacities, Input::sh_dc,
                            Input::sh_rest, Input::features, Input::screen_means}) {
    std::vector<double>& values = field(scene, input);
    const Gradient exact = gradient(scene, camera, options, weights, input);
    ASSERT_EQ(exact.sum.size(), values.size());
    std::size_t jumped = 0;
    for (std::size_t k = 0; k < values.size(); ++k) {
      const double value = values[k];
      values[k] = value + step;
      const double above = objective(scene, camera, options, weights);
      values[k] = value - step;
      const double below = objective(scene, camera, options, weights);
      values[k] = value;
      const double slope = (above - below) / (2 * step);
      // A pixel may have crossed alpha = 1/255: a jump of about 1/255 over 2e-6. All other derivatives agree closely.
      if (std::abs(slope - exact.sum[k]) > 100) {
        ++jumped;
      } else {
        EXPECT_NEAR(slope, exact.sum[k], 1e-5 * (1 + std::abs(slope))) << static_cast<int>(input) << " " << k;
      }
    }
    EXPECT_LE(jumped, values.size() / 20) << static_cast<int>(input);
  }
}

TEST(ReferenceRasterizer, DirectionalDerivativeIsTheGradientAlongTheDirection) {
  const Camera camera = small_camera();
  const Scene<double> scene = random_scene(5, 21);
  Scene<double> direction;
  Numbers random(8);
  for (std::size_t k = 0; k < scene.means.size(); ++k) direction.means.push_back(random(-1, 1));
  for (std::size_t k = 0; k < scene.opacities.size(); ++k) direction.opacities.push_back(random(-1, 1));
  ImageGradients weights;
  for (std::size_t k = 0; k < 3 * 37 * 21; ++k) weights.color.push_back(random(-1, 1));
  const Options options;
  const Gradient means = gradient(scene, camera, options, weights, Input::means);
  const Gradient opacities = gradient(scene, camera, options, weights, Input::opacities);
  double expected = 0;
  for (std::size_t k = 0; k < means.sum.size(); ++k) expected += means.sum[k] * direction.means[k];
  for (std::size_t k = 0; k < opacities.sum.size(); ++k) expected += opacities.sum[k] * direction.opacities[k];
  EXPECT_NEAR(directional_derivative(scene, direction, camera, options, weights), expected, 1e-10 * std::abs(expected));
}

TEST(ReferenceEllipse, SmallestInRectangleAgreesWithADenseSearch) {
  Numbers random(17);
  for (int trial = 0; trial < 300; ++trial) {
    const double a = random(0.01, 2), b = random(0.01, 2), c = random(-0.99, 0.99) * std::sqrt(a * b);
    const double x = random(-20, 30), y = random(-20, 30);
    const double exact = smallest_in_rectangle(a, c, b, x, y, 0.5, 15.5, 0.5, 15.5);
    double least = 1e300;
    for (int row = 0; row <= 300; ++row) {
      for (int column = 0; column <= 300; ++column) {
        const double dx = 0.5 + 0.05 * column - x, dy = 0.5 + 0.05 * row - y;
        least = std::min(least, a * dx * dx + 2 * c * dx * dy + b * dy * dy);
      }
    }
    EXPECT_LE(exact, least + 1e-9);
    EXPECT_GE(exact, least - 0.1 * std::sqrt(2 * (a + b) * std::max(least, 0.01)) - 0.01);
  }
}

TEST(ReferencePhotometric, GradientAgreesWithFiniteDifferences) {
  Numbers random(4);
  ImagePair images;
  images.width = 9;
  images.height = 7;
  for (int k = 0; k < 3 * 63; ++k) images.render.push_back(random(0, 1));
  for (int k = 0; k < 3 * 63; ++k) images.truth.push_back(random(0, 1));
  for (int k = 0; k < 63; ++k) images.valid.push_back(random(0, 1) > 0.3 ? 1 : 0);
  const auto exact = photometric_gradient(images, 0.3);
  for (std::size_t k = 0; k < images.render.size(); ++k) {
    const double value = images.render[k];
    images.render[k] = value + 1e-6;
    const double above = photometric(images, 0.3).total;
    images.render[k] = value - 1e-6;
    const double below = photometric(images, 0.3).total;
    images.render[k] = value;
    EXPECT_NEAR((above - below) / 2e-6, exact[k], 1e-8);
  }
}

TEST(ReferencePhotometric, EqualImagesHaveNoLoss) {
  ImagePair images;
  images.width = 5;
  images.height = 4;
  for (int k = 0; k < 60; ++k) images.render.push_back(k / 60.0);
  images.truth = images.render;
  const Loss loss = photometric(images, 0.2);
  EXPECT_EQ(loss.l1, 0);
  EXPECT_NEAR(loss.ssim, 1, 1e-12);
  EXPECT_NEAR(loss.total, 0, 1e-12);
}

TEST(ReferenceTraining, InclusionProbabilitiesSumToTheDraws) {
  const auto inclusion = inclusion_probabilities({1, 2, 3, 4}, 2);
  EXPECT_NEAR(inclusion[0] + inclusion[1] + inclusion[2] + inclusion[3], 2, 1e-12);
  // Worked out by hand: item 0 is drawn first, or second after each of the others.
  EXPECT_NEAR(inclusion[0], 0.1 + 0.2 * 1 / 8 + 0.3 * 1 / 7 + 0.4 * 1 / 6, 1e-12);
}

}  // namespace
}  // namespace splatboost::reference
