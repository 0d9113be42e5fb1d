// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "reference/training.h"
#include "splatboost/adam.h"
#include "support/compare.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

TEST(Adam, FollowsTheWitnessOverManySteps) {
  Threads threads(2);
  Numbers random(1);
  for (const std::size_t size : {1u, 7u, 16u, 33u, 1000u, 70001u}) {
    std::vector<float> values;
    for (std::size_t i = 0; i < size; ++i) values.push_back(random.real(-2, 2));
    std::vector<float> first(size, 0);
    std::vector<float> second(size, 0);
    const AdamOptions options{.learning_rate = 0.01f, .beta1 = 0.9f, .beta2 = 0.999f, .epsilon = 1e-15f};
    reference::AdamState exact{{values.begin(), values.end()}, std::vector<double>(size), std::vector<double>(size)};
    for (std::int64_t step = 1; step <= 25; ++step) {
      std::vector<float> gradients;
      // Magnitudes from tiny to large: Adam's step does not depend on the scale.
      for (std::size_t i = 0; i < size; ++i)
        gradients.push_back(static_cast<float>(random.uniform(-1, 1.5) * std::pow(10.0, -static_cast<double>(i % 9))));
      reference::adam_step(exact, {gradients.begin(), gradients.end()}, step, 0.01f, 0.9f, 0.999f, 1e-15f);
      adam_step(values, gradients, first, second, step, options, threads);
      for (const float gradient : gradients) ASSERT_EQ(gradient, 0);  // consumed
    }
    EXPECT_TRUE(is_close(values, exact.values, {.relative = 1e-5, .scale = 1e-6, .absolute = 2e-6, .l2 = 2e-6}));
    for (std::size_t i = 0; i < size; ++i) {
      const double scale = std::pow(10.0, -static_cast<double>(i % 9));
      ASSERT_NEAR(static_cast<double>(first[i]), exact.first[i], 1e-6 * scale) << i;
      ASSERT_NEAR(static_cast<double>(second[i]), exact.second[i], 1e-6 * scale * scale) << i;
    }
  }
}

TEST(Adam, TheFirstStepIsTheLearningRate) {
  Threads threads(1);
  std::vector<float> values{1, 1, 1, 1};
  std::vector<float> gradients{5, -5, 1e-8f, 0};
  std::vector<float> first(4, 0);
  std::vector<float> second(4, 0);
  adam_step(values, gradients, first, second, 1, {.learning_rate = 0.25f}, threads);
  EXPECT_NEAR(static_cast<double>(values[0]), 0.75, 1e-6);
  EXPECT_NEAR(static_cast<double>(values[1]), 1.25, 1e-6);
  EXPECT_NEAR(static_cast<double>(values[2]), 0.75, 1e-6);
  EXPECT_EQ(values[3], 1);  // 0 / (0 + ε)
}

TEST(Adam, LateStepsNeedNoCorrection) {
  Threads threads(1);
  std::vector<float> values{0};
  std::vector<float> gradients{2};
  std::vector<float> first{2};
  std::vector<float> second{4};
  adam_step(values, gradients, first, second, 1000000, {.learning_rate = 0.5f}, threads);
  EXPECT_NEAR(static_cast<double>(values[0]), -0.5, 1e-6);
  EXPECT_FLOAT_EQ(first[0], 2);
  EXPECT_FLOAT_EQ(second[0], 4);
}

TEST(Adam, OtherOptionsCount) {
  Threads threads(1);
  reference::AdamState exact{{0.5}, {0.1}, {0.2}};
  std::vector<float> values{0.5f};
  std::vector<float> gradients{0.3f};
  std::vector<float> first{0.1f};
  std::vector<float> second{0.2f};
  reference::adam_step(exact, {0.3}, 3, 0.1, 0.5, 0.9, 0.01);
  adam_step(values, gradients, first, second, 3,
            {.learning_rate = 0.1f, .beta1 = 0.5f, .beta2 = 0.9f, .epsilon = 0.01f}, threads);
  EXPECT_NEAR(static_cast<double>(values[0]), exact.values[0], 1e-7);
}

TEST(Adam, OfNothingIsNothing) {
  Threads threads(1);
  adam_step({}, {}, {}, {}, 1, {}, threads);
}

}  // namespace
}  // namespace splatboost::test
