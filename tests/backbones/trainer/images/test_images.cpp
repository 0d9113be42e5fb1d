// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

#include <glm/geometric.hpp>

#include "trainer/images/brown_conrady.h"
#include "trainer/images/image_codec.h"

namespace splatboost::test {
namespace {

TEST(ShrinkMask, APixelIsValidIfAllThatAreAveragedIntoItAre) {
  if (!have_opencv()) GTEST_SKIP() << "only OpenCV scales images";
  Pixels mask{6, 2, 1, 8, std::vector<std::uint8_t>(12, 255)};
  mask.bytes[1] = 0;  // part of the columns 0 and 1 of four, each 1.5 wide
  const Pixels shrunk = shrink_mask(mask, 4, 1, "mask");
  EXPECT_EQ(shrunk.bytes, (std::vector<std::uint8_t>{0, 0, 255, 255}));
}

TEST(BrownConrady, IsTheModelOfOpenCV) {
  const BrownConrady model{0.1, -0.05, 0.02, 0.003, -0.004};
  const double x = 0.4, y = -0.3, r2 = 0.25;
  const double radial = 1 + 0.1 * r2 - 0.05 * r2 * r2 + 0.02 * r2 * r2 * r2;
  const glm::dvec2 shown = model.distort({x, y});
  EXPECT_NEAR(shown.x, x * radial + 2 * 0.003 * x * y - 0.004 * (r2 + 2 * x * x), 1e-12);
  EXPECT_NEAR(shown.y, y * radial + 0.003 * (r2 + 2 * y * y) - 2 * 0.004 * x * y, 1e-12);
  EXPECT_FALSE(model.is_identity());
  EXPECT_TRUE(BrownConrady().is_identity());
}

TEST(BrownConrady, FoldsWhereTheDistortedRadiusStopsIncreasing) {
  const BrownConrady barrel{.k1 = -0.3};
  const double fold = 1 / std::sqrt(0.9);
  EXPECT_NEAR(barrel.fold_radius(2), fold, 0.001);
  EXPECT_EQ(barrel.fold_radius(1), 1);
  EXPECT_EQ(BrownConrady{.k1 = 0.3}.fold_radius(5), 5);
  EXPECT_LT(glm::length(barrel.distort({1.01 * fold, 0})), glm::length(barrel.distort({fold, 0})));
}

}  // namespace
}  // namespace splatboost::test
