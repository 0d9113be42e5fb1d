// SPDX-License-Identifier: Apache-2.0
// Backbones of explicit Gaussians that train on a CUDA device: against the same run on the CPU, with and without
// acceleration; that they never wait in the steady loop; checkpoints across devices; what happens when memory is short.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/trainer.h"
#include "cuda/cuda_device.h"
#include "cuda_training/training_runs.h"
#include "dropgaussian/dropgaussian.h"
#include "dropgaussian/dropgaussian_adapter.h"
#include "mip_splatting/mip_splatting.h"
#include "mip_splatting/mip_splatting_adapter.h"
#include "splatboost/errors.h"
#include "support/gaussian_checks.h"
#include "support/tiny_scene.h"
#include "vanilla/vanilla.h"
#include "vanilla/vanilla_adapter.h"

#ifdef SPLATBOOST_CUDA_ON_CPU
#include "cuda_on_cpu.h"
#endif

namespace splatboost::test {
namespace {

using testing::exported;
using testing::picture;

constexpr int kIterations = 60;

/// Settings under which a run of kIterations grows from iteration 4 on, and resets opacities at iteration 20.
template <class Config>
Config eager() {
  Config config;
  config.densify_interval = 4;
  config.published_iterations = kPublishedIterations;
  config.densify_until = 15000;
  return config;
}

/// Growths at 10 and 20, prunings by scores late in the run.
VanillaBoost eager_boost() {
  VanillaBoost boost;
  boost.late_min_opacity = 0.005;  // a run this short does not recover from the reset
  boost.densify_interval = 10;
  boost.views = 2;
  boost.seed = 3;
  return boost;
}

struct Method {
  std::string name;
  std::function<std::unique_ptr<Backbone>(const BackboneContext&)> make;
  std::function<std::unique_ptr<VanillaAdapter>(Device)> boost;
};

std::ostream& operator<<(std::ostream& out, const Method& method) { return out << method.name; }

const std::vector<Method>& methods() {
  static const std::vector<Method> all = {
      {"vanilla", [](const BackboneContext& c) { return make_vanilla(c, eager<VanillaConfig>()); },
       [](Device d) { return std::make_unique<VanillaAdapter>(eager_boost(), d); }},
      {"mip_splatting",
       [](const BackboneContext& c) {
         auto config = eager<MipSplattingConfig>();
         config.smoothing_interval = 7;
         return make_mip_splatting(c, config);
       },
       [](Device d) { return std::make_unique<MipSplattingAdapter>(eager_boost(), d); }},
      {"dropgaussian", [](const BackboneContext& c) { return make_dropgaussian(c, eager<DropGaussianConfig>()); },
       [](Device d) { return std::make_unique<VanillaAdapter>(eager_boost(), d); }},
  };
  return all;
}

class CudaTraining : public OnCuda<::testing::TestWithParam<Method>> {
 protected:
  BackboneContext context(Device device) {
    BackboneContext context{scene_, threads_, 3, kIterations, 200};
    context.device = device;
    return context;
  }
  std::unique_ptr<Backbone> make(Device device) { return GetParam().make(context(device)); }

  Trace run(Backbone& backbone, int first, int last) { return run_of(backbone, scene_, first, last); }
  void steps(Backbone& backbone, int first, int last) { testing::train(backbone, scene_, first, last); }
  /// A whole run that is accelerated, or as published.
  Trace whole_run(Device device, bool boosted) {
    const std::unique_ptr<Backbone> backbone = make(device);
    const std::unique_ptr<VanillaAdapter> adapter = GetParam().boost(device);
    if (boosted) {
      backbone->rasterizer_hook().set_beta(adapter->beta());
      backbone->set_hooks(adapter.get(), adapter.get());
    }
    return run(*backbone, 1, kIterations);
  }

  Threads threads_{1};
  Scene scene_ = testing::tiny_scene(threads_);
};

/// Both hold the same Gaussians, in whatever order: each has a twin.
void expect_same_set(const SplatCloud& found, const SplatCloud& expected) {
  ASSERT_EQ(found.size(), expected.size());
  const auto distance = [&](std::size_t i, std::size_t j) {
    double sum = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      sum += std::abs(found.means[3 * i + c] - expected.means[3 * j + c]) +
             std::abs(found.log_scales[3 * i + c] - expected.log_scales[3 * j + c]) +
             std::abs(found.sh_dc[3 * i + c] - expected.sh_dc[3 * j + c]);
    }
    return sum + std::abs(found.logit_opacities[i] - expected.logit_opacities[j]);
  };
  for (std::size_t i = 0; i < found.size(); ++i) {
    double nearest = distance(i, 0);
    for (std::size_t j = 1; j < expected.size(); ++j) nearest = std::min(nearest, distance(i, j));
    EXPECT_LT(nearest, 0.02) << "Gaussian " << i;
  }
}

TEST_P(CudaTraining, IsThatOfTheCpu) {
  const Trace expected = whole_run(threads_, false);
  EXPECT_GT(expected.primitives.back(), scene_.points.size()) << "this run shall grow";
  expect_same_run(whole_run(stream(), false), expected, 7);
}

TEST_P(CudaTraining, GrowsTheSameGaussians) {
  const std::unique_ptr<Backbone> there = make(stream()), here = make(threads_);
  EXPECT_GT(run(*here, 1, 4).primitives.back(), scene_.points.size());
  run(*there, 1, 4);
  expect_same_set(exported(*there), exported(*here));
}

TEST_P(CudaTraining, AcceleratedIsThatOfTheCpu) {
  const Trace expected = whole_run(threads_, true);
  EXPECT_GT(expected.primitives[25], scene_.points.size()) << "this run shall grow";
  EXPECT_LT(expected.primitives.back(), expected.primitives[25]) << "this run shall prune";
  expect_same_run(whole_run(stream(), true), expected, 9);
}

TEST_P(CudaTraining, NeverWaitsBetweenGrowths) {
  NeverGrows hook;
  const std::unique_ptr<Backbone> backbone = make(stream());
  backbone->set_hooks(&hook, nullptr);
  steps(*backbone, 1, 10);
  backbone->wait();  // all numbers have come back
  steps(*backbone, 8, 10);
  const CudaActivity before = stream().activity();
  // Mip-Splatting renews its filter within these.
  steps(*backbone, 11, 19);
  EXPECT_EQ(stream().activity().allocations, before.allocations);
  EXPECT_EQ(stream().activity().synchronizations, before.synchronizations);
  backbone->wait();
  for (const char* stage : {"render", "loss", "render_backward", "statistics", "optimizer"}) {
    ASSERT_TRUE(backbone->stages().seconds().contains(stage)) << stage;
    EXPECT_GT(backbone->stages().seconds().find(stage)->second, 0) << stage;
  }
}

TEST_P(CudaTraining, GoesOnFromACheckpointOnEitherDevice) {
  const TemporaryFolder folder;
  const std::unique_ptr<Backbone> first = make(stream());
  run(*first, 1, 25);
  testing::save_state(*first, folder / "checkpoint");
  const Trace expected = run(*first, 26, 40);
  for (const Device device : {Device(stream()), Device(threads_)}) {
    const std::unique_ptr<Backbone> second = make(device);
    testing::load_state(*second, folder / "checkpoint");
    // The next growth comes after iteration 28.
    expect_same_run(run(*second, 26, 40), expected, device.is_cuda() ? 15 : 2);
  }
}

TEST_P(CudaTraining, ModelsAndPicturesAreThoseOfTheCpu) {
  const std::unique_ptr<Backbone> trained = make(stream());
  run(*trained, 1, 12);
  trained->finish();
  const std::unique_ptr<Backbone> there = make(stream()), here = make(threads_);
  const SplatCloud cloud = exported(*trained);
  testing::import_cloud(*there, cloud);
  testing::import_cloud(*here, cloud);
  EXPECT_EQ(testing::model_bytes(*there), testing::model_bytes(*here));
  for (const View& view : scene_.test) {
    const std::vector<float> found = picture(*there, view), expected = picture(*here, view);
    for (std::size_t p = 0; p < found.size(); ++p) ASSERT_NEAR(found[p], expected[p], 1e-4);
  }
}

#ifdef SPLATBOOST_CUDA_ON_CPU
constexpr std::size_t kPlenty = std::size_t{4} << 30;

TEST_P(CudaTraining, AGrowthThatFindsNoMemoryLeavesTheModelWhole) {
  int failed = 0;
  for (const std::size_t more : {1u << 10, 1u << 13, 1u << 14, 1u << 15}) {
    const std::unique_ptr<Backbone> backbone = make(stream());
    run(*backbone, 1, 3);
    cuda_on_cpu::set_device_memory(cuda_on_cpu::device_memory_in_use() + more);
    try {
      run(*backbone, 4, 4);
    } catch (const DeviceMemoryError&) {
      ++failed;
    }
    EXPECT_EQ(exported(*backbone).size(), backbone->primitives());
    cuda_on_cpu::set_device_memory(kPlenty);
    EXPECT_TRUE(std::isfinite(run(*backbone, 5, 6).errors.back()));
  }
  EXPECT_GT(failed, 0);
}

TEST_P(CudaTraining, SavesTheModelWhereMemoryIsShort) {
  const TemporaryFolder folder;
  const std::unique_ptr<Backbone> backbone = make(stream());
  std::string message;
  TrainOptions options;
  options.iterations = kIterations;
  options.model = folder.path();
  options.quiet = true;
  options.curve_points = 0;
  options.on_start = [](std::size_t) {
    cuda_on_cpu::set_device_memory(cuda_on_cpu::device_memory_in_use() + (std::size_t{1} << 16));
  };
  try {
    train(*backbone, scene_, options);
  } catch (const DeviceMemoryError& error) {
    message = error.what();
  }
  cuda_on_cpu::set_device_memory(kPlenty);
  EXPECT_NE(message.find("bytes wanted"), std::string::npos) << message;
  EXPECT_NE(message.find("--max-primitives"), std::string::npos) << message;
  const auto from = message.find((folder / "point_cloud").string());
  ASSERT_NE(from, std::string::npos) << message;
  const std::string saved = message.substr(from, message.find(';', from) - from);
  EXPECT_GT(backbone->primitives(), 0u);
  EXPECT_EQ(read_splat_ply(std::filesystem::path(saved) / "point_cloud.ply").size(), backbone->primitives());
}
#endif

INSTANTIATE_TEST_SUITE_P(Methods, CudaTraining, ::testing::ValuesIn(methods()),
                         [](const auto& method) { return method.param.name; });

}  // namespace
}  // namespace splatboost::test
