// SPDX-License-Identifier: Apache-2.0
// Statistics for density control, against sums by hand.
#include "splatboost/density_statistics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

#include "splatboost/errors.h"
#include "splatboost/threads.h"

namespace splatboost::test {
namespace {

/// Four Gaussians, of which the second is not visible, in a view of 200 × 80 pixels. NDC range from −1 to 1 over the
/// view, so gradients per pixel are multiplied by 100 along x and by 40 along y, as in 3DGS.
class DensityStatistics : public ::testing::Test {
 protected:
  static constexpr int kWidth = 200, kHeight = 80;
  const std::vector<std::uint8_t> visible{1, 0, 1, 7};
  //                               in NDC:  (3, 4)         not seen     (-8, 15)        (0, -2)
  const std::vector<float> screen{0.03f, 0.1f, 9, 9, -0.08f, 0.375f, 0, -0.05f};
  //                                  in NDC:  (5, 12)        not seen     (20, 21)       (7, 24)
  const std::vector<float> screen_abs{0.05f, 0.3f, 9, 9, 0.2f, 0.525f, 0.07f, 0.6f};
  std::vector<float> norms{1, 2, 3, 4}, norms_abs{10, 20, 30, 40}, views{0, 5, 0.5f, 8};
  Threads threads{2};

  ScreenGradients view() const { return {visible, screen, screen_abs, kWidth, kHeight}; }
  ScreenGradientSums sums() { return {norms, norms_abs, views}; }
};

void expect_near(const std::vector<float>& found, const std::vector<float>& expected) {
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], expected[i], 1e-6f * expected[i]) << i;
}

TEST_F(DensityStatistics, AViewAddsNormsInNdcToThoseThatItSees) {
  add_screen_gradients(view(), AbsoluteNorm::euclidean, 2.5f, sums(), threads);
  expect_near(norms, {1 + 5, 2, 3 + 17, 4 + 2});
  expect_near(norms_abs, {10 + 13, 20, 30 + 29, 40 + 25});
  expect_near(views, {2.5f, 5, 3, 10.5f});
}

TEST_F(DensityStatistics, AbsoluteGradientsMayBeAddedAlongXAndY) {
  add_screen_gradients(view(), AbsoluteNorm::sum, 1, sums(), threads);
  expect_near(norms, {1 + 5, 2, 3 + 17, 4 + 2});  // signed gradients always have the Euclidean norm
  expect_near(norms_abs, {10 + 17, 20, 30 + 41, 40 + 31});
  expect_near(views, {1, 5, 1.5f, 9});
}

TEST_F(DensityStatistics, AbsoluteGradientsThatWereNotGatheredAddNothing) {
  ScreenGradients signed_only = view();
  signed_only.screen_abs = {};
  for (const AbsoluteNorm norm : {AbsoluteNorm::euclidean, AbsoluteNorm::sum}) {
    add_screen_gradients(signed_only, norm, 1, sums(), threads);
  }
  expect_near(norms, {1 + 2 * 5, 2, 3 + 2 * 17, 4 + 2 * 2});
  expect_near(norms_abs, {10, 20, 30, 40});
  expect_near(views, {2, 5, 2.5f, 10});
}

TEST_F(DensityStatistics, AViewMayCountAsNone) {
  add_screen_gradients(view(), AbsoluteNorm::euclidean, 0, sums(), threads);
  expect_near(norms, {1 + 5, 2, 3 + 17, 4 + 2});
  expect_near(views, {0, 5, 0.5f, 8});
}

TEST_F(DensityStatistics, MeansAreOverAtLeastOneView) {
  std::vector<float> means(4, 99.0f), means_abs(4, 99.0f);
  mean_screen_gradients(sums(), means, means_abs, threads);
  expect_near(means, {1, 0.4f, 3, 0.5f});
  expect_near(means_abs, {10, 4, 30, 5});
  expect_near(norms, {1, 2, 3, 4});
  expect_near(views, {0, 5, 0.5f, 8});
}

TEST_F(DensityStatistics, EveryOneOfManyIsAdded) {
  constexpr std::size_t kCount = 10007;  // more than one thread takes at a time
  std::vector<std::uint8_t> seen(kCount);
  std::vector<float> gradients(2 * kCount);
  for (std::size_t i = 0; i < kCount; ++i) {
    seen[i] = i % 3 == 1 ? 0 : 1;
    gradients[2 * i] = 0.001f * static_cast<float>(i % 100);
    gradients[2 * i + 1] = 0.002f * static_cast<float>(i % 77);
  }
  for (std::vector<float>* each : {&norms, &norms_abs, &views}) each->assign(kCount, 0);
  add_screen_gradients({seen, gradients, gradients, kWidth, kHeight}, AbsoluteNorm::sum, 1, sums(), threads);
  for (std::size_t i = 0; i < kCount; ++i) {
    const double x = seen[i] * 0.1 * static_cast<double>(i % 100), y = seen[i] * 0.08 * static_cast<double>(i % 77);
    ASSERT_NEAR(norms[i], std::hypot(x, y), 1e-5) << i;
    ASSERT_NEAR(norms_abs[i], x + y, 1e-5) << i;
    ASSERT_EQ(views[i], seen[i]) << i;
  }
}

TEST_F(DensityStatistics, RadiiAreKeptWhereObserved) {
  const std::vector<std::int32_t> radii{5, 9, 2, 7}, observed{1, 0, 300, 2};
  std::vector<std::int32_t> largest{3, 3, 3, 0};
  add_screen_radii(radii, observed, largest, threads);
  EXPECT_EQ(largest, (std::vector<std::int32_t>{5, 3, 3, 7}));
}

TEST_F(DensityStatistics, TheLongestScaleMayBeAlongAnyAxis) {
  const std::vector<float> scales{3, 2, 1, 4, 6, 5, 7, 8, 9, 0.5f, 0.5f, 0.5f};
  std::vector<float> longest(4);
  longest_scales(scales, longest, threads);
  EXPECT_EQ(longest, (std::vector<float>{3, 6, 9, 0.5f}));
}

TEST_F(DensityStatistics, OfAnotherNumberOfGaussiansAreRefused) {
  std::vector<float> five(5), three(3);
  const std::vector<std::int32_t> of_three(3), of_four(4);
  std::vector<std::int32_t> largest(4);
  EXPECT_THROW(add_screen_gradients(view(), AbsoluteNorm::sum, 1, {norms, norms_abs, three}, threads), ArgumentError);
  EXPECT_THROW(add_screen_gradients({visible, screen, five, kWidth, kHeight}, AbsoluteNorm::sum, 1, sums(), threads),
               ArgumentError);
  EXPECT_THROW(mean_screen_gradients(sums(), norms, three, threads), ArgumentError);
  EXPECT_THROW(longest_scales(five, three, threads), ArgumentError);
  EXPECT_THROW(add_screen_radii(of_three, of_four, largest, threads), ArgumentError);
}

}  // namespace
}  // namespace splatboost::test
