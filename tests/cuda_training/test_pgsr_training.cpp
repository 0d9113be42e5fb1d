// SPDX-License-Identifier: Apache-2.0
// PGSR on a CUDA device: its surface losses, filters and appearance as on the CPU, in whole runs.
#include <gtest/gtest.h>

#include "cuda_training/training_runs.h"
#include "pgsr/pgsr.h"
#include "pgsr/pgsr_adapter.h"

namespace splatboost::test {
namespace {

constexpr int kIterations = 60;

/// All loss terms are active from iteration 6 on, and neighbours may be far apart.
PgsrConfig eager() {
  PgsrConfig config;
  config.published_iterations = kPublishedIterations;
  config.percent_dense = 0.02;
  config.densify_interval = 10;
  config.densify_until = 15000;
  config.surface_from = 3000;
  config.split_radius = 4;
  config.neighbor_angle = 75;
  config.neighbor_farthest = 4;
  config.max_pixel_noise = 20;
  return config;
}

/// @param trim_views as in PgsrConfig
Method pgsr(const char* name, bool exposure, int trim_views = 2) {
  VanillaBoost boost = pgsr_boost();
  boost.late_min_opacity = 0.005;
  boost.views = 2;
  return {name,
          [exposure, trim_views](const BackboneContext& c) {
            PgsrConfig config = eager();
            config.exposure = exposure;
            config.trim_views = trim_views;
            return make_pgsr(c, config);
          },
          accelerated_by<PgsrAdapter>(boost)};
}

class CudaPgsr : public TrainingOnCuda {
 protected:
  CudaPgsr() : TrainingOnCuda(kIterations) { scene_ = testing::tiny_scene(threads_, 12); }
};

TEST_P(CudaPgsr, TrainsAsOnTheCpu) {
  const Trace expected = whole_run(threads_, false);
  EXPECT_GT(expected.primitives.back(), scene_.points.size()) << "this run shall grow";
  expect_same_run(whole_run(stream(), false), expected, 9);
}

TEST_P(CudaPgsr, AcceleratedIsThatOfTheCpu) {
  expect_same_run(whole_run(stream(), true), whole_run(threads_, true), 9);
}

TEST_P(CudaPgsr, GoesOnFromACheckpointOnEitherDevice) { expect_resume_on_either_device(25, 29, 2); }

TEST_P(CudaPgsr, ModelsAndPicturesAreThoseOfTheCpu) { expect_models_and_pictures_of_the_cpu(9); }

/// Without what the host waits for: exposure, which it decides by a loss, and trims.
class CudaPgsrSteadily : public CudaPgsr {};

TEST_P(CudaPgsrSteadily, NeverWaitsBetweenGrowths) { expect_no_wait_between_growths(19); }

INSTANTIATE_TEST_SUITE_P(Kinds, CudaPgsr, ::testing::Values(pgsr("plain", false), pgsr("exposure", true)),
                         [](const auto& method) { return method.param.name; });
INSTANTIATE_TEST_SUITE_P(Kinds, CudaPgsrSteadily, ::testing::Values(pgsr("plain", false, 0)),
                         [](const auto& method) { return method.param.name; });

}  // namespace
}  // namespace splatboost::test
