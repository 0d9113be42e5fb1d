// SPDX-License-Identifier: Apache-2.0
#include "trainer/backbone_api/training_truths.h"

#include <gtest/gtest.h>

namespace splatboost::test {
namespace {

TEST(TrainingIndex, IsThatOfTheViewWhateverItsSize) {
  Scene scene;
  scene.train.resize(3);
  scene.train_halves.resize(3);
  scene.test.resize(1);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(training_index(scene, scene.train[i]), i);
    EXPECT_EQ(training_index(scene, scene.train_halves[i]), i);
  }
  EXPECT_FALSE(training_index(scene, scene.test[0]).has_value());
  const View copy = scene.train[1];
  EXPECT_FALSE(training_index(scene, copy).has_value());
}

}  // namespace
}  // namespace splatboost::test
