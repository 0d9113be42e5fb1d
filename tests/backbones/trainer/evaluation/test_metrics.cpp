// SPDX-License-Identifier: Apache-2.0
#include "trainer/evaluation/metrics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace splatboost {
namespace {

struct Pair {
  int width, height;
  std::vector<float> render;
  std::vector<std::uint8_t> color, valid;
  TruthImage truth() const { return {width, height, color, valid}; }
  std::size_t pixels() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
};

// A random truth, and a render close to it with some values outside [0,1].
Pair random_pair(int width, int height, bool masked, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> byte(0, 255);
  std::normal_distribution<float> noise(0.0f, 0.2f);
  Pair pair{width, height, {}, {}, {}};
  for (std::size_t i = 0; i < 3 * pair.pixels(); ++i) {
    pair.color.push_back(static_cast<std::uint8_t>(byte(random)));
    pair.render.push_back(static_cast<float>(pair.color.back()) / 255.0f + noise(random));
  }
  for (std::size_t i = 0; masked && i < pair.pixels(); ++i) pair.valid.push_back(byte(random) < 200 ? 1 : 0);
  return pair;
}

double clamp01(double value) { return std::clamp(value, 0.0, 1.0); }

// Directly from the definition: every window summed in full, with two-dimensional weights.
double brute_force_ssim(const Pair& p) {
  double weights[11][11], norm = 0;
  for (int y = 0; y < 11; ++y) {
    for (int x = 0; x < 11; ++x) {
      weights[y][x] = std::exp(-((x - 5) * (x - 5) + (y - 5) * (y - 5)) / (2 * 1.5 * 1.5));
      norm += weights[y][x];
    }
  }
  double sum = 0, count = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < p.height; ++y) {
      for (int x = 0; x < p.width; ++x) {
        if (!p.valid.empty() && !p.valid[static_cast<std::size_t>(y * p.width + x)]) continue;
        double r = 0, t = 0, rr = 0, tt = 0, rt = 0;
        for (int v = std::max(0, y - 5); v <= std::min(p.height - 1, y + 5); ++v) {
          for (int u = std::max(0, x - 5); u <= std::min(p.width - 1, x + 5); ++u) {
            const std::size_t pixel = static_cast<std::size_t>(v * p.width + u);
            const double w = weights[v - y + 5][u - x + 5] / norm;
            const double truth = p.color[c * p.pixels() + pixel] / 255.0;
            const bool known = p.valid.empty() || p.valid[pixel];
            const double render = known ? clamp01(static_cast<double>(p.render[c * p.pixels() + pixel])) : truth;
            r += w * render;
            t += w * truth;
            rr += w * render * render;
            tt += w * truth * truth;
            rt += w * render * truth;
          }
        }
        sum += (2 * r * t + 1e-4) * (2 * (rt - r * t) + 9e-4) /
               ((r * r + t * t + 1e-4) * (rr - r * r + tt - t * t + 9e-4));
        count += 1;
      }
    }
  }
  return sum / count;
}

TEST(Psnr, OfAConstantOffset) {
  Pair pair{7, 5, {}, {}, {}};
  pair.color.assign(3 * pair.pixels(), 51);  // 0.2
  pair.render.assign(3 * pair.pixels(), 0.3f);
  EXPECT_NEAR(psnr(pair.render, pair.truth()), 20.0, 1e-5);
}

TEST(Psnr, OfEqualImagesIs100) {
  Pair pair = random_pair(20, 15, false);
  for (std::size_t i = 0; i < pair.render.size(); ++i) pair.render[i] = static_cast<float>(pair.color[i]) / 255.0f;
  EXPECT_EQ(psnr(pair.render, pair.truth()), 100.0);
}

TEST(Psnr, ClampsTheRender) {
  Pair pair{4, 4, std::vector<float>(48, 7.0f), std::vector<std::uint8_t>(48, 255), {}};
  EXPECT_EQ(psnr(pair.render, pair.truth()), 100.0);
  pair.render.assign(48, -3.0f);
  EXPECT_NEAR(psnr(pair.render, pair.truth()), 0.0, 1e-12);
}

TEST(Psnr, CountsOnlyValidPixels) {
  Pair pair{4, 1, std::vector<float>(12, 0.0f), std::vector<std::uint8_t>(12, 0), {1, 1, 0, 1}};
  for (const std::size_t c : {0u, 4u, 8u}) pair.render[c + 2] = 1.0f;  // hidden by the mask
  EXPECT_EQ(psnr(pair.render, pair.truth()), 100.0);
  pair.render[4 + 3] = 0.3f;  // one of 9 valid values
  EXPECT_NEAR(psnr(pair.render, pair.truth()), -10 * std::log10(0.09 / 9), 1e-5);
}

TEST(Psnr, ShowsThatARenderIsBroken) {
  Pair pair = random_pair(4, 4, false);
  pair.render[5] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(std::isnan(psnr(pair.render, pair.truth())));
  EXPECT_TRUE(std::isnan(ssim(pair.render, pair.truth())));
}

TEST(Ssim, OfEqualImagesIs1) {
  Pair pair = random_pair(31, 22, false);
  for (std::size_t i = 0; i < pair.render.size(); ++i) pair.render[i] = static_cast<float>(pair.color[i]) / 255.0f;
  EXPECT_NEAR(ssim(pair.render, pair.truth()), 1.0, 1e-7);
}

TEST(Ssim, MatchesTheDefinition) {
  // Larger than the window, smaller than it, and single rows and columns.
  for (const auto& [width, height] : {std::pair{29, 23}, {7, 30}, {30, 4}, {5, 5}, {1, 17}, {17, 1}, {11, 11}}) {
    for (const bool masked : {false, true}) {
      const Pair pair = random_pair(width, height, masked, 3);
      EXPECT_NEAR(ssim(pair.render, pair.truth()), brute_force_ssim(pair), 1e-12)
          << width << "×" << height << (masked ? " masked" : "");
    }
  }
}

TEST(Ssim, IsNotChangedByRendersOfInvalidPixels) {
  Pair pair = random_pair(25, 25, true);
  const double before = ssim(pair.render, pair.truth());
  for (std::size_t i = 0; i < pair.render.size(); ++i) {
    if (!pair.valid[i % pair.pixels()]) pair.render[i] = std::numeric_limits<float>::quiet_NaN();
  }
  EXPECT_EQ(ssim(pair.render, pair.truth()), before);
  EXPECT_FALSE(std::isnan(psnr(pair.render, pair.truth())));
}

TEST(Metrics, WithNoValidPixelNothingDiffers) {
  Pair pair = random_pair(12, 12, false);
  pair.valid.assign(pair.pixels(), 0);
  EXPECT_EQ(psnr(pair.render, pair.truth()), 100.0);
  EXPECT_EQ(ssim(pair.render, pair.truth()), 1.0);
}

TEST(Metrics, RefuseImagesOfAnotherSize) {
  Pair pair = random_pair(6, 6, false);
  pair.render.pop_back();
  EXPECT_THROW(psnr(pair.render, pair.truth()), std::invalid_argument);
  EXPECT_THROW(ssim(pair.render, pair.truth()), std::invalid_argument);
}

}  // namespace
}  // namespace splatboost
