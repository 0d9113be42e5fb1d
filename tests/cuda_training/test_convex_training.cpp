// SPDX-License-Identifier: Apache-2.0
// 3D Convex Splatting on a CUDA device trains as on the CPU.
#include <gtest/gtest.h>

#include "convex_splatting/convex_adapter.h"
#include "convex_splatting/convex_splatting.h"
#include "cuda_training/training_runs.h"

namespace splatboost::test {
namespace {

Method convexes() {
  ConvexBoost boost;
  boost.views = 2;
  return {"convex_splatting",
          [](const BackboneContext& c) {
            ConvexConfig config;
            config.densify_interval = 5;
            config.densify_until = 20000;
            config.gradient_threshold = 2e-6;
            return make_convex_splatting(c, config);
          },
          accelerated_by<ConvexAdapter>(boost)};
}

class CudaConvexes : public TrainingOnCuda {
 protected:
  CudaConvexes() : TrainingOnCuda(12) { most_primitives_ = 90; }
};

TEST_P(CudaConvexes, TrainAsOnTheCpu) {
  const Trace expected = whole_run(threads_, false);
  EXPECT_GT(expected.primitives.back(), scene_.points.size()) << "this run shall grow";
  expect_same_run(whole_run(stream(), false), expected, 3);
}

TEST_P(CudaConvexes, TrainAsOnTheCpuWithTheirAdapter) {
  expect_same_run(whole_run(stream(), true), whole_run(threads_, true), 3);
}

TEST_P(CudaConvexes, GoOnFromACheckpointOnEitherDevice) { expect_resume_on_either_device(6, 8, 2); }

INSTANTIATE_TEST_SUITE_P(Release, CudaConvexes, ::testing::Values(convexes()),
                         [](const auto& method) { return method.param.name; });

}  // namespace
}  // namespace splatboost::test
