// SPDX-License-Identifier: Apache-2.0
// Backbones of anchors that train on a CUDA device: against the same run on the CPU, with and without acceleration;
// that they never wait in the steady loop; checkpoints and models across devices; growth where memory is short.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <string>

#include "cuda/cuda_device.h"
#include "cuda_training/training_runs.h"
#include "octree_gs/octree_adapter.h"
#include "octree_gs/octree_gs.h"
#include "scaffold_gs/scaffold_adapter.h"
#include "scaffold_gs/scaffold_gs.h"
#include "splatboost/errors.h"
#include "support/anchor_model.h"
#include "support/tiny_scene.h"

#ifdef SPLATBOOST_CUDA_ON_CPU
#include "cuda_on_cpu.h"
#endif

namespace splatboost::test {
namespace {

using testing::picture;

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

template <class Boost>
Boost eager_boost() {
  Boost boost;
  boost.views = 2;
  boost.tau_d = 1;
  boost.seed = 3;
  return boost;
}

struct Method {
  std::string name;
  std::function<std::unique_ptr<Backbone>(const BackboneContext&)> make;
  std::function<std::unique_ptr<ScaffoldAdapter>(Device)> boost;
};

std::ostream& operator<<(std::ostream& out, const Method& method) { return out << method.name; }

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
  const auto scaffold_boost = [](Device d) {
    return std::make_unique<ScaffoldAdapter>(eager_boost<ScaffoldBoost>(), d);
  };
  const auto octree_boost = [](Device d) {
    auto boost = eager_boost<OctreeBoost>();
    boost.slots_per_anchor = kSlots;
    boost.tau_d = 20;
    return std::make_unique<OctreeAdapter>(boost, d);
  };
  static const std::vector<Method> all = {
      {"scaffold", [](const BackboneContext& c) { return scaffold(c, false); }, scaffold_boost},
      {"scaffold_with_all", [](const BackboneContext& c) { return scaffold(c, true); }, scaffold_boost},
      {"octree", octree, octree_boost},
  };
  return all;
}

class CudaAnchorTraining : public OnCuda<::testing::TestWithParam<Method>> {
 protected:
  std::unique_ptr<Backbone> make(Device device) {
    BackboneContext context{scene_, threads_, 3, kIterations, 200};
    context.device = device;
    return GetParam().make(context);
  }
  Trace run(Backbone& backbone, int first, int last) { return run_of(backbone, scene_, first, last); }
  void steps(Backbone& backbone, int first, int last) { testing::train(backbone, scene_, first, last); }
  /// A whole run that is accelerated, or as published.
  Trace whole_run(Device device, bool boosted) {
    const std::unique_ptr<Backbone> backbone = make(device);
    const std::unique_ptr<ScaffoldAdapter> adapter = GetParam().boost(device);
    if (boosted) {
      backbone->rasterizer_hook().set_beta(adapter->beta());
      backbone->set_hooks(adapter.get(), nullptr);
    }
    return run(*backbone, 1, kIterations);
  }

  Threads threads_{1};
  Scene scene_ = testing::tiny_scene(threads_);
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

TEST_P(CudaAnchorTraining, NeverWaitsBetweenGrowths) {
  NeverGrows hook;
  const std::unique_ptr<Backbone> backbone = make(stream());
  backbone->set_hooks(&hook, nullptr);
  steps(*backbone, 1, 10);
  backbone->wait();  // all numbers have come back
  steps(*backbone, 8, 10);
  const CudaActivity before = stream().activity();
  steps(*backbone, 11, 17);
  EXPECT_EQ(stream().activity().allocations, before.allocations);
  EXPECT_EQ(stream().activity().synchronizations, before.synchronizations);
  backbone->wait();
  for (const char* stage : {"render", "loss", "render_backward", "statistics", "optimizer"}) {
    ASSERT_TRUE(backbone->stages().seconds().contains(stage)) << stage;
    EXPECT_GT(backbone->stages().seconds().find(stage)->second, 0) << stage;
  }
}

TEST_P(CudaAnchorTraining, GoesOnFromACheckpointOnEitherDevice) {
  const TemporaryFolder folder;
  const std::unique_ptr<Backbone> first = make(stream());
  run(*first, 1, 15);
  testing::save_state(*first, folder / "checkpoint");
  const Trace expected = run(*first, 16, 22);
  for (const Device device : {Device(stream()), Device(threads_)}) {
    const std::unique_ptr<Backbone> second = make(device);
    testing::load_state(*second, folder / "checkpoint");
    expect_same_run(run(*second, 16, 22), expected, device.is_cuda() ? 7 : 2);
  }
}

TEST_P(CudaAnchorTraining, ModelsAndPicturesAreThoseOfTheCpu) {
  const TemporaryFolder folder;
  const std::unique_ptr<Backbone> trained = make(stream());
  run(*trained, 1, 14);
  trained->finish();
  trained->export_model(folder.path());
  const std::unique_ptr<Backbone> there = make(stream()), here = make(threads_);
  there->import_model(folder.path());
  here->import_model(folder.path());
  EXPECT_EQ(testing::model_bytes(*there), testing::model_bytes(*here));
  for (const View& view : scene_.test) {
    const std::vector<float> found = picture(*there, view), expected = picture(*here, view);
    for (std::size_t p = 0; p < found.size(); ++p) ASSERT_NEAR(found[p], expected[p], 1e-4);
  }
}

#ifdef SPLATBOOST_CUDA_ON_CPU
TEST_P(CudaAnchorTraining, AGrowthThatFindsNoMemoryLeavesTheModelWhole) {
  constexpr std::size_t kPlenty = std::size_t{4} << 30;
  int failed = 0;
  for (const std::size_t more : {1u << 10, 1u << 13, 1u << 15}) {
    const std::unique_ptr<Backbone> backbone = make(stream());
    run(*backbone, 1, 11);
    cuda_on_cpu::set_device_memory(cuda_on_cpu::device_memory_in_use() + more);
    try {
      run(*backbone, 12, 12);
    } catch (const DeviceMemoryError&) {
      ++failed;
    }
    EXPECT_EQ(testing::exported(*backbone, {"x"}).size(), backbone->primitives());
    cuda_on_cpu::set_device_memory(kPlenty);
    EXPECT_TRUE(std::isfinite(run(*backbone, 13, 14).errors.back()));
  }
  EXPECT_GT(failed, 0);
}
#endif

INSTANTIATE_TEST_SUITE_P(Methods, CudaAnchorTraining, ::testing::ValuesIn(methods()),
                         [](const auto& method) { return method.param.name; });

}  // namespace
}  // namespace splatboost::test
