// SPDX-License-Identifier: Apache-2.0
// Training backbones of explicit Gaussians on a CUDA device: against the same run on the CPU, with and without
// acceleration; no waits in the steady loop; checkpoints across devices; growth with too little memory.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "cuda_training/training_runs.h"
#include "dropgaussian/dropgaussian.h"
#include "dropgaussian/dropgaussian_adapter.h"
#include "mip_splatting/mip_splatting.h"
#include "mip_splatting/mip_splatting_adapter.h"
#include "splatboost/errors.h"
#include "support/gaussian_checks.h"
#include "trainer/training/trainer.h"
#include "vanilla/vanilla.h"
#include "vanilla/vanilla_adapter.h"

namespace splatboost::test {
namespace {

using testing::exported;

constexpr int kIterations = 60;

/// Settings with which a run of kIterations grows from iteration 4 on, and resets opacities at iteration 20.
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
  boost.late_min_opacity = 0.005;  // opacities do not recover from the reset in so short a run
  boost.densify_interval = 10;
  boost.views = 2;
  boost.seed = 3;
  return boost;
}

const std::vector<Method>& methods() {
  static const std::vector<Method> all = {
      {"vanilla", [](const BackboneContext& c) { return make_vanilla(c, eager<VanillaConfig>()); },
       accelerated_by<VanillaAdapter>(eager_boost())},
      {"mip_splatting",
       [](const BackboneContext& c) {
         auto config = eager<MipSplattingConfig>();
         config.smoothing_interval = 7;
         return make_mip_splatting(c, config);
       },
       accelerated_by<MipSplattingAdapter>(eager_boost())},
      {"dropgaussian", [](const BackboneContext& c) { return make_dropgaussian(c, eager<DropGaussianConfig>()); },
       accelerated_by<VanillaAdapter>(eager_boost())},
  };
  return all;
}

class CudaTraining : public TrainingOnCuda {
 protected:
  CudaTraining() : TrainingOnCuda(kIterations) {}
};

/// Both clouds have the same Gaussians, in any order.
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

TEST_P(CudaTraining, AStartOnHalfViewsIsThatOfTheCpu) { expect_coarse_start_of_the_cpu(3); }

// Mip-Splatting updates its 3D filter within these iterations.
TEST_P(CudaTraining, NeverWaitsBetweenGrowths) { expect_no_wait_between_growths(19); }

// The next growth comes after iteration 28.
TEST_P(CudaTraining, GoesOnFromACheckpointOnEitherDevice) { expect_resume_on_either_device(25, 40, 2); }

TEST_P(CudaTraining, ModelsAndPicturesAreThoseOfTheCpu) { expect_models_and_pictures_of_the_cpu(12); }

TEST_P(CudaTraining, AveragesAreThoseOfTheCpu) { expect_averages_of_the_cpu(10); }

#ifdef SPLATBOOST_CUDA_ON_CPU
TEST_P(CudaTraining, GoesOnWithoutAveragesIfMemoryRunsOut) { expect_no_averages_without_memory(10); }

TEST_P(CudaTraining, AGrowthThatFindsNoMemoryLeavesTheModelWhole) {
  expect_whole_model_without_memory(4, {1u << 10, 1u << 13, 1u << 14, 1u << 15});
}

TEST_P(CudaTraining, SavesTheModelIfMemoryRunsOutRightAfterAGrowth) {
  const std::unique_ptr<Backbone> backbone = make(stream());
  run(*backbone, 1, 3);
  const std::size_t before = backbone->primitives();
  cuda_on_cpu::set_device_memory(cuda_on_cpu::device_memory_in_use() +
                                 79'000);  // not enough for Mip-Splatting's filters
  EXPECT_THROW(run(*backbone, 4, 4), DeviceMemoryError);
  EXPECT_NE(backbone->primitives(), before);
  const TemporaryFolder folder;
  backbone->export_model(folder.path());
  cuda_on_cpu::set_device_memory(kPlenty);
  EXPECT_EQ(read_splat_ply(folder / "point_cloud.ply").size(), backbone->primitives());
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
  EXPECT_NE(message.find("bytes requested"), std::string::npos) << message;
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
