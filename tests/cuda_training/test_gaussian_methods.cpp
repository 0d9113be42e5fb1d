// SPDX-License-Identifier: Apache-2.0
// Toy methods of explicit Gaussians that use all of the interface (support/toy_methods.h), on a CUDA device.
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "cuda_training/training_runs.h"
#include "support/toy_methods.h"

namespace splatboost::test {
namespace {

template <class Toy>
Method toy(const char* name) {
  return {name,
          [](const BackboneContext& c) {
            return make_gaussian_backbone(c, testing::eager_toy_config(), std::make_unique<Toy>(c.device));
          },
          nullptr};
}

/// A method whose loss reads two views.
Method own_loss() {
  return {"own_loss",
          [](const BackboneContext& c) {
            return make_gaussian_backbone(c, testing::eager_toy_config(),
                                          std::make_unique<testing::OwnLossMethod>(c.device, c.scene, true));
          },
          nullptr};
}

class CudaMethods : public TrainingOnCuda {
 protected:
  CudaMethods() : TrainingOnCuda(60) { testing::spread_times(scene_); }
};

TEST_P(CudaMethods, TrainAsOnTheCpu) {
  const Trace expected = whole_run(threads_, false);
  EXPECT_GT(expected.primitives.back(), scene_.points.size()) << "this run shall grow";
  expect_same_run(whole_run(stream(), false), expected, 3);
}

TEST_P(CudaMethods, GoOnFromACheckpointOnEitherDevice) { expect_resume_on_either_device(25, 32, 2); }

TEST_P(CudaMethods, ModelsAndPicturesAreThoseOfTheCpu) { expect_models_and_pictures_of_the_cpu(12); }

INSTANTIATE_TEST_SUITE_P(Toys, CudaMethods,
                         ::testing::Values(toy<testing::MovingMethod>("moving"),
                                           toy<testing::OwnGroupsMethod>("own_groups"), own_loss()),
                         [](const auto& method) { return method.param.name; });

}  // namespace
}  // namespace splatboost::test
