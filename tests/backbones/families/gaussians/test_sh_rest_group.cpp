// SPDX-License-Identifier: Apache-2.0
// The group of higher SH bands: factors or gradients, the same steps.
#include "families/gaussians/sh_rest_group.h"

#include <gtest/gtest.h>

#include <vector>

#include "support/scenes.h"
#include "support/temporary_folder.h"

namespace splatboost {
namespace {

constexpr std::size_t kCount = 37;
constexpr std::size_t kWidth = 3 * kRestRows;

class ShRestGroupTest : public ::testing::Test {
 protected:
  ShRestGroupTest() {
    std::vector<float> values;
    for (std::size_t i = 0; i < kWidth * kCount; ++i) values.push_back(random_.real(-1, 1));
    group_.assign(values);
    plain_.assign(std::move(values));
  }

  /// What the rasterizer does in one backward pass, for the group and for one that has gradients only.
  void pass(int degree, bool steps_soon) {
    std::vector<float> factors, gradients(kWidth * kCount);
    for (std::size_t i = 0; i < kCount; ++i) {
      const float drawn = i % 7 == 3 ? 0.0f : 1.0f;
      for (const float x : {0.6f, 0.0f, 0.8f}) factors.push_back(x);
      for (int c = 0; c < 3; ++c) factors.push_back(drawn * random_.real(-1, 1));
    }
    const ShFactors view{factors, degree};
    sum_sh_gradients({&view, 1}, kRestRows, gradients, threads_);
    for (std::size_t i = 0; i < gradients.size(); ++i) plain_.gradients.host()[i] += gradients[i];
    plain_.pending = true;

    GaussianGradients to;
    group_.receive(to, degree, steps_soon);
    ASSERT_NE(to.sh_factors.empty(), to.sh_rest.empty());
    holds_factors_ = !to.sh_factors.empty();
    if (holds_factors_) {
      ASSERT_EQ(to.sh_factors.size(), factors.size());
      std::copy(factors.begin(), factors.end(), to.sh_factors.begin());
    } else {
      for (std::size_t i = 0; i < gradients.size(); ++i) to.sh_rest[i] += gradients[i];
    }
    group_.pending = true;
  }

  void step() {
    const AdamOptions options{.learning_rate = 0.01f};
    group_.step(options, threads_);
    plain_.step(options, threads_);
    EXPECT_EQ(group_.values.host(), plain_.values.host());
    EXPECT_EQ(group_.first_moments.host(), plain_.first_moments.host());
    EXPECT_EQ(group_.second_moments.host(), plain_.second_moments.host());
    EXPECT_EQ(group_.steps, plain_.steps);
    EXPECT_FALSE(group_.pending);
  }

  test::Numbers random_{1};
  Threads threads_{2};
  ShRestGroup group_{threads_, [](int) { return 0.01; }};
  TrainedGroup plain_{"f_rest", kWidth, threads_, [](int) { return 0.01; }};
  bool holds_factors_ = false;  ///< of the last pass
};

TEST_F(ShRestGroupTest, steps_by_factors_if_a_step_follows_soon) {
  for (const int views : {1, 4, 7}) {
    for (int i = 0; i < views; ++i) {
      pass(1 + i % 3, true);
      EXPECT_TRUE(holds_factors_);
    }
    step();
  }
}

TEST_F(ShRestGroupTest, more_views_than_have_room_become_gradients) {
  for (int i = 0; i < 10; ++i) {
    pass(3, true);
    EXPECT_EQ(holds_factors_, i < 7);
  }
  step();
  pass(3, true);
  EXPECT_TRUE(holds_factors_);
  step();
}

TEST_F(ShRestGroupTest, sums_gradients_if_no_step_follows_soon_also_after_factors) {
  pass(3, true);
  step();
  for (int i = 0; i < 12; ++i) {
    pass(2, i > 8);  // what was begun with gradients goes on with them
    EXPECT_FALSE(holds_factors_);
  }
  step();
}

TEST_F(ShRestGroupTest, may_be_expanded_at_any_time) {
  group_.expand();
  pass(3, true);
  pass(2, true);
  group_.expand();
  EXPECT_EQ(group_.gradients.host(), plain_.gradients.host());
  pass(3, true);
  EXPECT_FALSE(holds_factors_);
  step();
  group_.expand();
  pass(3, false);
  step();
}

TEST_F(ShRestGroupTest, archives_hold_gradients) {
  pass(3, true);
  pass(1, true);
  const test::TemporaryFolder folder;
  ArchiveWriter archive;
  group_.save(archive);
  archive.write(folder / "state");
  EXPECT_EQ(ArchiveReader(folder / "state").floats("f_rest.gradients"), plain_.gradients.host());
  group_.load(ArchiveReader(folder / "state"));
  pass(3, true);
  EXPECT_FALSE(holds_factors_);
  step();

  // The factors of a step that was made are not gradients.
  pass(3, true);
  step();
  ArchiveWriter after;
  group_.save(after);
  after.write(folder / "after");
  EXPECT_EQ(ArchiveReader(folder / "after").floats("f_rest.gradients"), std::vector<float>(kWidth * kCount));
}

TEST_F(ShRestGroupTest, new_values_forget_what_was_pending) {
  pass(3, true);
  const std::vector<float> values = plain_.values.host();
  group_.assign(values);
  plain_.assign(values);
  pass(2, false);
  step();
}

TEST_F(ShRestGroupTest, does_not_step_without_gradients) {
  pass(3, true);
  step();
  const std::vector<float> values = group_.values.host();
  group_.step({.learning_rate = 0.01f}, threads_);
  EXPECT_EQ(group_.values.host(), values);
}

}  // namespace
}  // namespace splatboost
