// SPDX-License-Identifier: Apache-2.0
// Masks and statistics of convexes.
#include <gtest/gtest.h>

#include <vector>

#include "splatboost/convex_training.h"
#include "splatboost/errors.h"

namespace splatboost::test {
namespace {

TEST(ConvexMasks, HideAtAndBelowTheThresholdAndPassGradientsStraightThrough) {
  Threads threads(1);
  const std::vector<float> opacities{0.5f, 0.25f, 0.75f}, masks{0.8f, kConvexMaskThreshold, 0.011f};
  std::vector<float> drawn(3, 9.0f);
  mask_opacities(opacities, masks, drawn, threads);
  EXPECT_EQ(drawn, (std::vector<float>{0.5f, 0.0f, 0.75f})) << "not weighted by the mask";
  const std::vector<float> gradients{2, 4, -1};
  std::vector<float> of_opacities(3, 1.0f), of_masks(3, 10.0f);
  mask_opacities_backward(opacities, masks, gradients, 0.125f, of_opacities, of_masks, threads);
  EXPECT_EQ(of_opacities, (std::vector<float>{3, 1, 0}));
  EXPECT_EQ(of_masks, (std::vector<float>{11.125f, 11.125f, 9.375f})) << "as if drawn = opacity · mask";
  drawn.resize(2);
  EXPECT_THROW(mask_opacities(opacities, masks, drawn, threads), ArgumentError);
}

TEST(SharpnessGradients, AreSummedWithTheirSignWhereVisible) {
  Threads threads(1);
  std::vector<float> sums{1, 1, 1}, sums_abs{0, 0, 0}, views{5, 5, 5};
  const std::vector<std::uint8_t> visible{1, 0, 1};
  const std::vector<float> gradients{-2, 7, 3}, absolute{2, 7, 4};
  add_sharpness_gradients(visible, gradients, absolute, {sums, sums_abs, views}, threads);
  add_sharpness_gradients(visible, gradients, {}, {sums, sums_abs, views}, threads);
  EXPECT_EQ(sums, (std::vector<float>{-3, 1, 7}));
  EXPECT_EQ(sums_abs, (std::vector<float>{2, 0, 4}));
  EXPECT_EQ(views, (std::vector<float>{7, 5, 7}));
  EXPECT_THROW(add_sharpness_gradients(visible, gradients, absolute, {sums, {}, views}, threads), ArgumentError);
}

}  // namespace
}  // namespace splatboost::test
