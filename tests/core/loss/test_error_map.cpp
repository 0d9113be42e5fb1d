// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "reference/photometric.h"
#include "splatboost/error_map.h"
#include "support/compare.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

struct View {
  int width;
  int height;
  std::vector<float> render;
  std::vector<std::uint8_t> truth;
  std::vector<std::uint8_t> valid;
  std::vector<float> error;
  std::vector<std::uint8_t> flagged;

  View(int w, int h) : width(w), height(h) {
    const std::size_t pixels = static_cast<std::size_t>(w) * static_cast<std::size_t>(h);
    render.assign(3 * pixels, 0);
    truth.assign(3 * pixels, 0);
    error.assign(pixels, -1);
    flagged.assign(pixels, 77);
  }
  std::size_t flag(float tau, const Threads& threads) {
    return flag_errors(render, TruthImage{width, height, truth, valid}, tau, error, flagged, threads).flagged;
  }
};

View random_view(int width, int height, std::uint64_t seed) {
  View view(width, height);
  Numbers random(seed);
  for (std::size_t k = 0; k < view.render.size(); ++k) {
    view.render[k] = random.real(0, 1);
    view.truth[k] = static_cast<std::uint8_t>(random.bits() % 256);
  }
  return view;
}

TEST(ErrorMap, AHandMadeView) {
  Threads threads(1);
  View view(4, 1);
  // Errors 0, 0.1, 0.3, 1 (means over channels), which are their normalised values too.
  view.render = {0, 0.3f, 0.1f, 1, 0, 0, 0.3f, 1, 0, 0, 0.5f, 1};
  EXPECT_EQ(view.flag(0.2f, threads), 2u);
  EXPECT_EQ(view.flagged, (std::vector<std::uint8_t>{0, 0, 1, 1}));
  EXPECT_FLOAT_EQ(view.error[1], 0.1f);
  EXPECT_FLOAT_EQ(view.error[2], 0.3f);
  EXPECT_EQ(view.flag(0.0f, threads), 3u);
  EXPECT_EQ(view.flag(0.99f, threads), 1u);
  EXPECT_EQ(view.flag(1.0f, threads), 0u);
}

TEST(ErrorMap, AConstantErrorFlagsNothing) {
  Threads threads(2);
  View view(31, 17);
  for (const float value : {0.0f, 0.25f, 1.0f}) {
    view.render.assign(view.render.size(), value);
    EXPECT_EQ(view.flag(0.1f, threads), 0u);
    for (const std::uint8_t flag : view.flagged) EXPECT_EQ(flag, 0);
    EXPECT_EQ(view.flag(0.0f, threads), 0u);
  }
  View single(1, 1);
  single.render = {0.9f, 0.1f, 0.4f};
  EXPECT_EQ(single.flag(0.1f, threads), 0u);
}

TEST(ErrorMap, AgreesWithTheWitness) {
  Threads threads(2);
  for (const bool masked : {false, true}) {
    for (const float tau : {0.1f, 0.5f, 0.9f}) {
      View view = random_view(97, 61, 5);
      Numbers random(6);
      if (masked) {
        for (int k = 0; k < 97 * 61; ++k) view.valid.push_back(random.uniform(0, 1) < 0.4 ? 0 : 200);
      }
      reference::ImagePair pair{97, 61, {view.render.begin(), view.render.end()}, {}, view.valid};
      for (const std::uint8_t byte : view.truth) pair.truth.push_back(byte / 255.0);
      const auto exact = reference::error_map(pair);
      const std::size_t number = view.flag(tau, threads);
      std::size_t in_doubt = 0;
      for (std::size_t p = 0; p < view.flagged.size(); ++p) {
        if (std::abs(exact.normalized[p] - static_cast<double>(tau)) < 1e-5) {
          ++in_doubt;
        } else {
          const bool valid = view.valid.empty() || view.valid[p] != 0;
          EXPECT_EQ(view.flagged[p], valid && exact.normalized[p] > static_cast<double>(tau) ? 1 : 0) << p;
        }
        if (view.valid.empty() || view.valid[p] != 0) {
          EXPECT_NEAR(static_cast<double>(view.error[p]), exact.error[p], 1e-6);
        }
      }
      EXPECT_LE(in_doubt, 3u);
      EXPECT_EQ(number, static_cast<std::size_t>(std::accumulate(view.flagged.begin(), view.flagged.end(), 0)));
      EXPECT_GT(number, 0u);
    }
  }
}

TEST(ErrorMap, MaskedPixelsTakeNoPart) {
  Threads threads(1);
  View view(4, 1);
  view.render = {0, 0.3f, 0.1f, 1, 0, 0, 0.3f, 1, 0, 0, 0.5f, 1};
  view.valid = {0, 1, 1, 0};  // the least and the largest error are masked
  EXPECT_EQ(view.flag(0.9f, threads), 1u);
  EXPECT_EQ(view.flagged, (std::vector<std::uint8_t>{0, 0, 1, 0}));
  view.render[3] = std::numeric_limits<float>::quiet_NaN();
  view.render[0] = std::numeric_limits<float>::infinity();
  EXPECT_EQ(view.flag(0.9f, threads), 1u);
  EXPECT_EQ(view.flagged, (std::vector<std::uint8_t>{0, 0, 1, 0}));
  view.valid = {0, 0, 0, 0};
  EXPECT_EQ(view.flag(0.1f, threads), 0u);
  EXPECT_EQ(view.flagged, (std::vector<std::uint8_t>{0, 0, 0, 0}));
}

}  // namespace
}  // namespace splatboost::test
