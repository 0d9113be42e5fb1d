// SPDX-License-Identifier: Apache-2.0
// Backbones of anchors that train on a CUDA device: against the same run on the CPU, with and without acceleration;
// that they never wait in the steady loop; checkpoints and models across devices; growth where memory is short.
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "cuda_training/training_runs.h"
#include "octree_gs/octree_gs.h"
#include "scaffold_gs/scaffold_adapter.h"
#include "scaffold_gs/scaffold_gs.h"

namespace splatboost::test {
namespace {

constexpr int kIterations = 32;
constexpr std::size_t kSlots = 3, kFeatures = 8;

/// Settings under which a run of kIterations grows at 12, 18 …
template <class Config>
Config eager() {
  Config config;
  config.feat_dim = kFeatures;
  config.n_offsets = kSlots;
  config.grow_interval = 6;
  config.statistics_from = 0;
  config.grow_from = 10000;
  config.gradient_threshold = 1e-4;
  config.min_opacity = 0.05;
  return config;
}

ScaffoldBoost eager_boost() {
  ScaffoldBoost boost;
  boost.views = 2;
  boost.seed = 3;
  return boost;
}

std::unique_ptr<Backbone> scaffold(const BackboneContext& context, bool all_options) {
  auto config = eager<ScaffoldConfig>();
  config.voxel_size = 0.02;
  if (all_options) {
    config.appearance_dim = 4;
    config.use_feat_bank = config.add_opacity_dist = config.add_color_dist = true;
  }
  return make_scaffold(context, config);
}

std::unique_ptr<Backbone> octree(const BackboneContext& context) {
  auto config = eager<OctreeConfig>();
  config.levels = 4;
  config.base_layer = 3;
  config.grow_from = 13000;
  config.add_level = true;
  return make_octree(context, config);
}

const std::vector<Method>& methods() {
  static const std::vector<Method> all = {
      {"scaffold", [](const BackboneContext& c) { return scaffold(c, false); },
       accelerated_by<ScaffoldAdapter>(eager_boost())},
      {"scaffold_with_all", [](const BackboneContext& c) { return scaffold(c, true); },
       accelerated_by<ScaffoldAdapter>(eager_boost())},
      {"octree", octree, accelerated_by<ScaffoldAdapter>(eager_boost())},
  };
  return all;
}

class CudaAnchorTraining : public TrainingOnCuda {
 protected:
  CudaAnchorTraining() : TrainingOnCuda(kIterations) {}
};

TEST_P(CudaAnchorTraining, IsThatOfTheCpu) {
  const Trace expected = whole_run(threads_, false);
  EXPECT_NE(expected.primitives.back(), expected.primitives.front()) << "this run shall grow or prune";
  expect_same_run(whole_run(stream(), false), expected, 12);
}

TEST_P(CudaAnchorTraining, AcceleratedIsThatOfTheCpu) {
  const Trace expected = whole_run(threads_, true), published = whole_run(threads_, false);
  EXPECT_NE(expected.primitives, published.primitives) << "acceleration shall matter";
  expect_same_run(whole_run(stream(), true), expected, 12);
}

TEST_P(CudaAnchorTraining, AStartOnHalfViewsIsThatOfTheCpu) { expect_coarse_start_of_the_cpu(5); }

TEST_P(CudaAnchorTraining, NeverWaitsBetweenGrowths) { expect_no_wait_between_growths(17); }

TEST_P(CudaAnchorTraining, GoesOnFromACheckpointOnEitherDevice) { expect_resume_on_either_device(15, 22, 2); }

TEST_P(CudaAnchorTraining, ModelsAndPicturesAreThoseOfTheCpu) { expect_models_and_pictures_of_the_cpu(14); }

#ifdef SPLATBOOST_CUDA_ON_CPU
TEST_P(CudaAnchorTraining, AGrowthThatFindsNoMemoryLeavesTheModelWhole) {
  expect_whole_model_without_memory(12, {1u << 10, 1u << 13, 1u << 15});
}
#endif

INSTANTIATE_TEST_SUITE_P(Methods, CudaAnchorTraining, ::testing::ValuesIn(methods()),
                         [](const auto& method) { return method.param.name; });

}  // namespace
}  // namespace splatboost::test
