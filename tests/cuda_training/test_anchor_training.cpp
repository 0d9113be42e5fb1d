// SPDX-License-Identifier: Apache-2.0
// Training backbones of anchors on a CUDA device: against the same run on the CPU, with and without acceleration; no
// waits in the steady loop; checkpoints and models across devices; growth with too little memory.
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "cuda_training/training_runs.h"
#include "octree_gs/octree_gs.h"
#include "scaffold_gs/scaffold_adapter.h"
#include "scaffold_gs/scaffold_gs.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

constexpr int kIterations = 32;
constexpr std::size_t kSlots = 3, kFeatures = 8;

/// Settings with which a run of kIterations grows at 12, 18 …
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

std::unique_ptr<Backbone> coarse_scaffold(const BackboneContext& context) {
  auto config = eager<ScaffoldConfig>();
  config.voxel_size = 0.5;
  return make_scaffold(context, config);
}

std::unique_ptr<Backbone> octree_of_three_levels(const BackboneContext& context) {
  auto config = eager<OctreeConfig>();
  config.levels = 3;
  config.base_layer = 4;
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

/// Each view sees some of the anchors, so that the number of rows is set from the views once 64 of these are known.
class CudaAnchorTrainingOfParts : public CudaAnchorTraining {
 protected:
  static constexpr int kKnown = 77, kLast = 90;
  CudaAnchorTrainingOfParts() {
    iterations_ = 320;  // the finest level of the octree opens at 80
    most_primitives_ = 5000;
    for (std::size_t i = 0; i < 1300; ++i) {  // some far away around all cameras, most between them
      const std::vector<float> at = numbers(3, -1, 1, 1000 + i);
      const float length = std::sqrt(at[0] * at[0] + at[1] * at[1] + at[2] * at[2]);
      for (const float x : at) scene_.points.positions.push_back(i < 400 ? 12 * x / length : 1.3f * x);
      for (int c = 0; c < 3; ++c) scene_.points.colors.push_back(static_cast<std::uint8_t>(40 * (i % 6)));
    }
  }
  /// A run up to iteration `last` that allocates rows for some of the anchors from kKnown on.
  std::unique_ptr<Backbone> trained(Device device, int last) {
    std::unique_ptr<Backbone> backbone = make(device);
    backbone->set_hooks(&hook_, nullptr);
    testing::train(*backbone, scene_, 1, kKnown);
    backbone->wait();  // all counts have arrived on the host
    testing::train(*backbone, scene_, kKnown + 1, last);
    return backbone;
  }

  NeverGrows hook_;
};

TEST_P(CudaAnchorTrainingOfParts, IsThatOfTheCpu) {
  const std::unique_ptr<Backbone> there = trained(stream(), kLast), here = trained(threads_, kLast);
  for (const View& view : scene_.train) {
    const std::vector<float> found = testing::picture(*there, view), expected = testing::picture(*here, view);
    double sum = 0;
    for (std::size_t p = 0; p < found.size(); ++p) sum += std::abs(found[p] - expected[p]);
    EXPECT_LT(sum / static_cast<double>(found.size()), 1e-4);
  }
}

TEST_P(CudaAnchorTrainingOfParts, NeverWaits) {
  const std::unique_ptr<Backbone> backbone = trained(stream(), kKnown + 5);  // a level that opens may need more memory
  backbone->wait();
  testing::train(*backbone, scene_, kKnown + 6, kKnown + 8);
  const CudaActivity before = stream().activity();
  testing::train(*backbone, scene_, kKnown + 9, kLast);
  EXPECT_EQ(stream().activity().allocations, before.allocations);
  EXPECT_EQ(stream().activity().synchronizations, before.synchronizations);
}

INSTANTIATE_TEST_SUITE_P(Methods, CudaAnchorTrainingOfParts,
                         ::testing::Values(Method{"scaffold", coarse_scaffold, {}},
                                           Method{"octree", octree_of_three_levels, {}}),
                         [](const auto& method) { return method.param.name; });

#ifdef SPLATBOOST_CUDA_ON_CPU
TEST_P(CudaAnchorTraining, AGrowthThatFindsNoMemoryLeavesTheModelWhole) {
  expect_whole_model_without_memory(12, {1u << 10, 1u << 13, 1u << 15});
}
#endif

INSTANTIATE_TEST_SUITE_P(Methods, CudaAnchorTraining, ::testing::ValuesIn(methods()),
                         [](const auto& method) { return method.param.name; });

}  // namespace
}  // namespace splatboost::test
