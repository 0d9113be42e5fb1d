// SPDX-License-Identifier: Apache-2.0
// SSIM of float images against brute force: value, gradient, sizes around those of strips and of the window, padding.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "reference/photometric.h"
#include "splatboost/errors.h"
#include "splatboost/ssim.h"
#include "support/compare.h"
#include "support/instruction_sets.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

struct Pair {
  SsimPlanes planes;
  std::vector<float> images, truths;
};

Pair noise(int width, int height, std::uint64_t seed) {
  Numbers random(seed);
  Pair pair;
  pair.planes = {3, width, height};
  for (int k = 0; k < 3 * width * height; ++k) {
    pair.truths.push_back(random.real(0, 1));
    pair.images.push_back(pair.truths.back() + random.real(-0.4, 0.4));
  }
  return pair;
}

TEST(Ssim, AgreesWithBruteForceAtEverySize) {
  for_each_target([&] {
    Threads threads(2);
    const int sizes[][2] = {{1, 1}, {2, 9}, {11, 11}, {17, 5}, {33, 20}, {7, 63}, {9, 64}, {6, 65}, {13, 131}};
    for (const auto& size : sizes) {
      SCOPED_TRACE(std::to_string(size[0]) + "x" + std::to_string(size[1]));
      const Pair pair = noise(size[0], size[1], 3);
      reference::ImagePair exact;
      exact.width = size[0];
      exact.height = size[1];
      exact.render.assign(pair.images.begin(), pair.images.end());
      exact.truth.assign(pair.truths.begin(), pair.truths.end());
      std::vector<float> gradient(pair.images.size(), std::nanf(""));
      const double mean = ssim(pair.planes, pair.images, pair.truths, SsimPadding::same, gradient, threads);
      EXPECT_NEAR(mean, reference::photometric(exact, 1.0).ssim, 5e-6);
      EXPECT_EQ(mean, ssim(pair.planes, pair.images, pair.truths, SsimPadding::same, {}, threads));

      std::vector<std::size_t> elements;
      std::vector<float> picked;
      for (std::size_t k = 0; k<gradient.size(); k += gradient.size()> 500 ? 23 : 1) {
        elements.push_back(k);
        picked.push_back(-gradient[k]);  // the loss is 1 − SSIM
      }
      const auto slopes = reference::photometric_gradient(exact, 1.0, elements);
      EXPECT_TRUE(is_close(picked, slopes, {.relative = 2e-4, .scale = 1e-4, .absolute = 0, .l2 = 5e-5}));
    }
  });
}

TEST(Ssim, ValidWindowsAreThoseOfThePlaneAlone) {
  // Windows that lie within the image do not depend on the outside: the SSIM of a crop of a larger image is the same.
  Threads threads(2);
  const Pair pair = noise(40, 30, 5);
  double sum = 0;
  for (int y = 0; y < 30 - 10; ++y) {
    for (int x = 0; x < 40 - 10; ++x) {
      std::vector<float> a, b;
      for (int plane = 0; plane < 3; ++plane) {
        for (int j = 0; j < 11; ++j) {
          for (int i = 0; i < 11; ++i) {
            a.push_back(pair.images[static_cast<std::size_t>((plane * 30 + y + j) * 40 + x + i)]);
            b.push_back(pair.truths[static_cast<std::size_t>((plane * 30 + y + j) * 40 + x + i)]);
          }
        }
      }
      sum += ssim({3, 11, 11}, a, b, SsimPadding::valid, {}, threads);
    }
  }
  std::vector<float> gradient(pair.images.size());
  const double mean = ssim(pair.planes, pair.images, pair.truths, SsimPadding::valid, gradient, threads);
  EXPECT_NEAR(mean, sum / (20 * 30), 1e-6);

  Pair moved = pair;
  for (const std::size_t k : {std::size_t{0}, std::size_t{45}, std::size_t{655}, std::size_t{1299}}) {
    moved.images[k] = pair.images[k] + 0.01f;
    const double up = ssim(moved.planes, moved.images, moved.truths, SsimPadding::valid, {}, threads);
    moved.images[k] = pair.images[k] - 0.01f;
    const double down = ssim(moved.planes, moved.images, moved.truths, SsimPadding::valid, {}, threads);
    moved.images[k] = pair.images[k];
    EXPECT_NEAR(static_cast<double>(gradient[k]), (up - down) / 0.02, 1e-6 + 0.02 * std::abs(up - down) / 0.02) << k;
  }
}

TEST(Ssim, IsTheSameForAnyNumberOfThreads) {
  const Pair pair = noise(70, 140, 8);
  Threads one(1), three(3);
  std::vector<float> a(pair.images.size()), b(pair.images.size());
  EXPECT_EQ(ssim(pair.planes, pair.images, pair.truths, SsimPadding::same, a, one),
            ssim(pair.planes, pair.images, pair.truths, SsimPadding::same, b, three));
  EXPECT_EQ(a, b);
}

TEST(Ssim, RefusesWhatHoldsNoWindow) {
  Threads threads(1);
  Pair pair = noise(10, 20, 1);
  EXPECT_THROW(ssim(pair.planes, pair.images, pair.truths, SsimPadding::valid, {}, threads), ArgumentError);
  EXPECT_THROW(ssim({0, 10, 20}, {}, {}, SsimPadding::same, {}, threads), ArgumentError);
  pair.truths.pop_back();
  EXPECT_THROW(ssim(pair.planes, pair.images, pair.truths, SsimPadding::same, {}, threads), ArgumentError);
}

}  // namespace
}  // namespace splatboost::test
