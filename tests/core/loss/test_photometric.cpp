// SPDX-License-Identifier: Apache-2.0
// The photometric loss against brute force: value, gradient, masks, sizes around those of strips and of the window.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "reference/photometric.h"
#include "splatboost/photometric.h"
#include "support/compare.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

struct Picture {
  int width = 0;
  int height = 0;
  std::vector<float> render;
  std::vector<std::uint8_t> truth;
  std::vector<std::uint8_t> valid;

  std::size_t pixels() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
  TruthImage view() const { return {width, height, truth, valid}; }
  reference::ImagePair exact() const {
    reference::ImagePair images;
    images.width = width;
    images.height = height;
    images.render.assign(render.begin(), render.end());
    for (const std::uint8_t byte : truth) images.truth.push_back(byte / 255.0);
    images.valid = valid;
    return images;
  }
};

/// @param invalid fraction of masked pixels; 0: no mask
Picture noise(int width, int height, double invalid, std::uint64_t seed) {
  Numbers random(seed);
  Picture picture;
  picture.width = width;
  picture.height = height;
  for (std::size_t k = 0; k < 3 * picture.pixels(); ++k) {
    picture.truth.push_back(static_cast<std::uint8_t>(random.bits() % 256));
    // Renders are not clamped: some values lie outside [0,1].
    picture.render.push_back(random.real(-0.1, 1.2));
  }
  if (invalid > 0) {
    for (std::size_t k = 0; k < picture.pixels(); ++k)
      picture.valid.push_back(random.uniform(0, 1) < invalid ? 0 : static_cast<std::uint8_t>(1 + k % 255));
  }
  return picture;
}

/// An image like a photograph: smooth, with edges; the render differs slightly.
Picture scenery(int width, int height, double error, std::uint64_t seed) {
  Numbers random(seed);
  Picture picture;
  picture.width = width;
  picture.height = height;
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const double value = 0.5 + 0.4 * std::sin(0.11 * x + 0.07 * y * (c + 1)) + (x > width / 2 ? 0.1 : 0);
        picture.truth.push_back(static_cast<std::uint8_t>(std::lround(255 * std::min(1.0, std::max(0.0, value)))));
        picture.render.push_back(static_cast<float>(picture.truth.back() / 255.0 + random.uniform(-error, error)));
      }
    }
  }
  return picture;
}

void check(const Picture& picture, float lambda, Photometric& photometric, const std::string& what) {
  const auto exact_pair = picture.exact();
  const auto exact = reference::photometric(exact_pair, static_cast<double>(lambda));
  std::vector<float> gradient(picture.render.size(), std::nanf(""));
  const PhotometricLoss loss = photometric.evaluate(picture.render, picture.view(), lambda, gradient);
  EXPECT_NEAR(loss.l1, exact.l1, 1e-6) << what;
  EXPECT_NEAR(loss.ssim, exact.ssim, 5e-6) << what;
  EXPECT_NEAR(loss.total, exact.total, 5e-6) << what;

  std::vector<std::size_t> elements;
  std::vector<float> picked;
  const std::size_t stride = picture.render.size() > 2000 ? 13 : 1;
  for (std::size_t k = 0; k < picture.render.size(); ++k) {
    EXPECT_TRUE(std::isfinite(gradient[k])) << what;
    if (k % stride != 0) continue;
    elements.push_back(k);
    picked.push_back(gradient[k]);
  }
  const auto slopes = reference::photometric_gradient(exact_pair, static_cast<double>(lambda), elements);
  EXPECT_TRUE(is_close(picked, slopes, {.relative = 2e-4, .scale = 1e-4, .absolute = 0, .l2 = 5e-5})) << what;

  const PhotometricLoss value_only = photometric.evaluate(picture.render, picture.view(), lambda, {});
  EXPECT_EQ(value_only.l1, loss.l1) << what;
  EXPECT_EQ(value_only.ssim, loss.ssim) << what;
  EXPECT_EQ(value_only.total, loss.total) << what;
}

TEST(Photometric, AgreesWithBruteForceAtEverySize) {
  Threads threads(2);
  Photometric photometric(threads);  // one object for all sizes: its workspace must keep no state
  const int sizes[][2] = {{1, 1},   {2, 1},   {1, 7},   {5, 5},   {6, 4},   {11, 11},  {15, 16},
                          {16, 17}, {33, 10}, {1, 130}, {130, 1}, {67, 35}, {20, 150}, {3, 3}};
  for (const auto& size : sizes) {
    for (const float lambda : {0.2f, 1.0f}) {
      check(noise(size[0], size[1], 0, 1 + size[0]), lambda, photometric,
            std::to_string(size[0]) + "x" + std::to_string(size[1]) + " λ " + std::to_string(lambda));
    }
  }
}

TEST(Photometric, AgreesWithBruteForceUnderMasks) {
  Threads threads(2);
  Photometric photometric(threads);
  for (const double invalid : {0.1, 0.5, 0.97}) {
    for (const float lambda : {0.0f, 0.2f, 1.0f})
      check(noise(37, 41, invalid, 7), lambda, photometric, "masked " + std::to_string(invalid));
  }
  // A mask of large regions, and one with a single valid pixel.
  Picture half = noise(40, 70, 0, 8);
  for (int k = 0; k < 40 * 70; ++k) half.valid.push_back(k % 40 < 17 && k / 40 > 20 ? 1 : 0);
  check(half, 0.2f, photometric, "half");
  Picture single = noise(20, 20, 0, 9);
  single.valid.assign(400, 0);
  single.valid[187] = 1;
  check(single, 0.2f, photometric, "single valid pixel");
}

TEST(Photometric, AgreesWithBruteForceOnScenery) {
  Threads threads(2);
  Photometric photometric(threads);
  check(scenery(60, 50, 0.2, 3), 0.2f, photometric, "rough");
  check(scenery(60, 50, 0.03, 4), 0.2f, photometric, "close");
}

TEST(Photometric, LambdaZeroIsL1Alone) {
  Threads threads(1);
  Photometric photometric(threads);
  const Picture picture = noise(19, 23, 0, 5);
  check(picture, 0, photometric, "λ 0");
  std::vector<float> gradient(picture.render.size());
  const PhotometricLoss loss = photometric.evaluate(picture.render, picture.view(), 0, gradient);
  EXPECT_DOUBLE_EQ(loss.total, loss.l1);
  const double step = 1.0 / static_cast<double>(picture.render.size());
  for (std::size_t k = 0; k < gradient.size(); ++k) {
    const double sign = static_cast<double>(picture.render[k]) > picture.truth[k] / 255.0 ? 1 : -1;
    EXPECT_NEAR(static_cast<double>(gradient[k]), sign * step, 1e-9) << k;
  }
}

TEST(Photometric, EqualImagesHaveNoLossAndNoPull) {
  Threads threads(2);
  Photometric photometric(threads);
  Picture picture = noise(30, 30, 0, 6);
  for (std::size_t k = 0; k < picture.render.size(); ++k) picture.truth[k] = picture.truth[k] < 128 ? 0 : 255;
  for (std::size_t k = 0; k < picture.render.size(); ++k) picture.render[k] = picture.truth[k] == 0 ? 0.0f : 1.0f;
  std::vector<float> gradient(picture.render.size(), 9);
  const PhotometricLoss loss = photometric.evaluate(picture.render, picture.view(), 0.2f, gradient);
  EXPECT_EQ(loss.l1, 0);
  EXPECT_NEAR(loss.ssim, 1, 1e-6);
  EXPECT_NEAR(loss.total, 0, 1e-6);
  for (const float slope : gradient) EXPECT_NEAR(static_cast<double>(slope), 0, 1e-7);
}

TEST(Photometric, OppositeImagesAreFarApart) {
  Threads threads(1);
  Photometric photometric(threads);
  Picture picture = noise(30, 30, 0, 6);
  for (std::size_t k = 0; k < picture.render.size(); ++k)
    picture.render[k] = static_cast<float>(1 - picture.truth[k] / 255.0);
  const PhotometricLoss loss = photometric.evaluate(picture.render, picture.view(), 0.2f, {});
  EXPECT_LT(loss.ssim, -0.5);
  EXPECT_GT(loss.total, 0.5);
}

TEST(Photometric, WhatIsMaskedCannotMatter) {
  Threads threads(2);
  Photometric photometric(threads);
  const Picture picture = noise(29, 31, 0.3, 10);
  Picture other = picture;
  for (std::size_t k = 0; k < other.render.size(); ++k) {
    if (other.valid[k % other.pixels()] == 0)
      other.render[k] = k % 3 == 0 ? std::numeric_limits<float>::quiet_NaN() : 1e30f;
  }
  std::vector<float> a(picture.render.size(), 9);
  std::vector<float> b(picture.render.size(), 9);
  const PhotometricLoss loss_a = photometric.evaluate(picture.render, picture.view(), 0.2f, a);
  const PhotometricLoss loss_b = photometric.evaluate(other.render, other.view(), 0.2f, b);
  EXPECT_EQ(loss_a.total, loss_b.total);
  EXPECT_EQ(a, b);
  for (std::size_t k = 0; k < a.size(); ++k) {
    if (picture.valid[k % picture.pixels()] == 0) {
      EXPECT_EQ(a[k], 0);
    }
  }
}

TEST(Photometric, NoValidPixelGivesNoGradientAndFiniteNumbers) {
  Threads threads(2);
  Photometric photometric(threads);
  Picture picture = noise(20, 20, 0, 11);
  picture.valid.assign(400, 0);
  std::vector<float> gradient(picture.render.size(), 9);
  const PhotometricLoss loss = photometric.evaluate(picture.render, picture.view(), 0.2f, gradient);
  EXPECT_TRUE(std::isfinite(loss.l1));
  EXPECT_TRUE(std::isfinite(loss.ssim));
  EXPECT_TRUE(std::isfinite(loss.total));
  for (const float slope : gradient) EXPECT_EQ(slope, 0);
}

TEST(Photometric, AFullMaskIsNoMask) {
  Threads threads(2);
  Photometric photometric(threads);
  Picture picture = noise(50, 34, 0, 12);
  std::vector<float> a(picture.render.size());
  std::vector<float> b(picture.render.size());
  const PhotometricLoss without = photometric.evaluate(picture.render, picture.view(), 0.2f, a);
  picture.valid.assign(picture.pixels(), 3);
  const PhotometricLoss with = photometric.evaluate(picture.render, picture.view(), 0.2f, b);
  EXPECT_DOUBLE_EQ(without.total, with.total);
  EXPECT_EQ(a, b);
}

}  // namespace
}  // namespace splatboost::test
