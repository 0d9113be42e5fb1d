// SPDX-License-Identifier: Apache-2.0
// The same bytes for any number of threads: forward, loss, backward, counts, Adam, neighbours, error maps.
#include <gtest/gtest.h>

#include <atomic>
#include <cstring>
#include <vector>

#include "splatboost/adam.h"
#include "splatboost/error_map.h"
#include "splatboost/neighbors.h"
#include "splatboost/photometric.h"
#include "splatboost/rasterizer.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

/// All results of a few training steps.
std::vector<float> train(int thread_count, BoxPolicy box) {
  const Camera camera = oblique_camera(150, 117);
  SceneSpec spec;
  spec.count = 3000;
  spec.sh_degree = 2;
  spec.features = 1;
  spec.largest = 5;
  SceneData scene = random_scene(camera, spec, 44);
  const SceneData goal = random_scene(camera, spec, 45);

  Threads threads(thread_count);
  EXPECT_EQ(threads.count(), thread_count);
  Rasterizer rasterizer(threads);
  Photometric photometric(threads);
  RasterOptions options;
  options.box = box;
  options.beta = 0.5f;
  options.compensate_opacity = true;

  ImageData images(camera, 1);
  rasterizer.forward(camera, goal.view(), options, images.view());
  std::vector<std::uint8_t> truth;
  for (const float value : images.color)
    truth.push_back(static_cast<std::uint8_t>(std::min(255.0f, std::max(0.0f, 255 * value))));
  const TruthImage truth_image{camera.width, camera.height, truth, {}};

  std::vector<float> everything;
  const auto keep = [&](const std::vector<float>& values) {
    everything.insert(everything.end(), values.begin(), values.end());
  };
  std::vector<std::vector<float>*> tensors{&scene.means, &scene.scales, &scene.opacities, &scene.sh_dc, &scene.sh_rest};
  std::vector<std::vector<float>> first;
  std::vector<std::vector<float>> second;
  for (const auto* tensor : tensors) {
    first.emplace_back(tensor->size(), 0.0f);
    second.emplace_back(tensor->size(), 0.0f);
  }
  GradientData gradients(scene, 0);
  std::vector<float> image_gradient(images.color.size());
  for (std::int64_t step = 1; step <= 4; ++step) {
    rasterizer.forward(camera, scene.view(), options, images.view());
    const PhotometricLoss loss = photometric.evaluate(images.color, truth_image, 0.2f, image_gradient);
    RasterImageGradients driving;
    driving.color = image_gradient;
    driving.alpha = images.inverse_depth;  // arbitrary values of the right shape
    rasterizer.backward(scene.view(), driving,
                        gradients.view(step % 2 == 0 ? GradientMode::overwrite : GradientMode::accumulate));
    keep(images.color);
    keep(images.features);
    keep(image_gradient);
    keep(gradients.means);
    keep(gradients.rotations);
    keep(gradients.sh_rest);
    keep(gradients.screen_means);
    keep(gradients.screen_means_abs);
    keep({static_cast<float>(loss.l1), static_cast<float>(loss.ssim), static_cast<float>(loss.total)});
    std::vector<std::vector<float>*> slopes{&gradients.means, &gradients.scales, &gradients.opacities, &gradients.sh_dc,
                                            &gradients.sh_rest};
    for (std::size_t k = 0; k < tensors.size(); ++k) {
      adam_step(*tensors[k], *slopes[k], first[k], second[k], step, {.learning_rate = 1e-4f}, threads);
    }
    for (float& opacity : scene.opacities) opacity = std::min(1.0f, std::max(0.0f, opacity));
    std::vector<float> error(images.alpha.size());
    std::vector<std::uint8_t> flagged(images.alpha.size());
    flag_errors(images.color, truth_image, 0.1f, error, flagged, threads);
    std::vector<std::int32_t> counts(scene.count, 0);
    rasterizer.count_flagged(flagged, counts);
    for (const std::int32_t count : counts) everything.push_back(static_cast<float>(count));
    keep(error);
  }
  std::vector<float> distances(scene.count);
  mean_squared_neighbor_distances(scene.means, 3, distances, threads);
  keep(distances);
  for (const auto* tensor : tensors) keep(*tensor);
  return everything;
}

TEST(Determinism, AnyNumberOfThreadsGivesTheSameBytes) {
  for (const BoxPolicy box : {BoxPolicy::square, BoxPolicy::ellipse}) {
    const std::vector<float> one = train(1, box);
    for (const int count : {1, 2, 3}) {
      const std::vector<float> many = train(count, box);
      ASSERT_EQ(one.size(), many.size());
      EXPECT_EQ(std::memcmp(one.data(), many.data(), one.size() * sizeof(float)), 0) << count << " threads";
    }
  }
}

TEST(Threads, VisitEveryIndexOnceInPiecesOfTheGrain) {
  for (const int count : {1, 2, 4}) {
    Threads threads(count);
    for (const std::size_t n : {0u, 1u, 7u, 64u, 1000u}) {
      std::vector<std::atomic<int>> visits(n);
      std::atomic<bool> misfit{false};
      threads.for_range(n, 16, [&](std::size_t begin, std::size_t end) {
        if (begin % 16 != 0 || (end != n && end - begin != 16) || end > n || end <= begin) misfit = true;
        for (std::size_t i = begin; i < end; ++i) ++visits[i];
      });
      EXPECT_FALSE(misfit);
      for (const auto& visit : visits) EXPECT_EQ(visit, 1);
    }
  }
  EXPECT_GE(Threads().count(), 1);
}

}  // namespace
}  // namespace splatboost::test
