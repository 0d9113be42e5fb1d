// SPDX-License-Identifier: Apache-2.0
#include "trainer/synth/bench_scene.h"

#include <cmath>

#include "splatboost/constants.h"
#include "splatboost/random.h"

namespace splatboost {
namespace {

constexpr std::uint64_t kSeed = 1;
constexpr float kFocalPerWidth = 0.9f;
constexpr int kRestRows = 15;
// Standard deviation of the logarithm of each axis' scale. With the default BenchSize::deviation, the 60k scene has the
// density of the CPU benchmarks of the field: about 56 splats blended per pixel.
constexpr double kDeviationSpread = 0.5;
constexpr double kNearest = 2, kFarthest = 10;

const BenchSize kSizes[] = {{"20k", 20000, 400, 300}, {"60k", 60000, 640, 480}, {"200k", 200000, 1024, 680}};

/// Smooth noise: a few waves of random direction per channel.
std::vector<std::uint8_t> noise_photo(int width, int height) {
  const RandomStream random(kSeed, 1, RandomPurpose::synth);
  std::vector<std::uint8_t> photo;
  photo.reserve(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  constexpr int kWaves = 6;
  for (std::uint64_t c = 0; c < 3; ++c) {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        double value = 0.5;
        for (std::uint64_t w = 0; w < kWaves; ++w) {
          const std::uint64_t at = 3 * (c * kWaves + w);
          value += 0.12 * std::sin(0.12 * (random.uniform(at) - 0.5) * x + 0.12 * (random.uniform(at + 1) - 0.5) * y +
                                   6.28 * random.uniform(at + 2));
        }
        photo.push_back(static_cast<std::uint8_t>(std::lround(255 * std::fmin(std::fmax(value, 0.0), 1.0))));
      }
    }
  }
  return photo;
}

}  // namespace

std::span<const BenchSize> bench_sizes() { return kSizes; }

Gaussians BenchScene::gaussians() const {
  Gaussians gaussians;
  gaussians.count = cloud.size();
  gaussians.means = cloud.means;
  gaussians.scales = scales;
  gaussians.rotations = cloud.rotations;
  gaussians.opacities = opacities;
  gaussians.sh_dc = cloud.sh_dc;
  gaussians.sh_rest = cloud.sh_rest;
  gaussians.sh_rest_rows = cloud.sh_rest_rows;
  gaussians.sh_degree = kMaxShDegree;
  return gaussians;
}

BenchScene make_bench_scene(const BenchSize& size) {
  BenchScene bench;
  View view;
  view.name = "bench";
  Camera& camera = view.camera;
  camera.width = size.width;
  camera.height = size.height;
  camera.fx = camera.fy = kFocalPerWidth * static_cast<float>(size.width);
  camera.cx = 0.5f * static_cast<float>(size.width);
  camera.cy = 0.5f * static_cast<float>(size.height);
  view.color = noise_photo(size.width, size.height);
  bench.scene.train.push_back(view);
  bench.scene.extent = 1;

  SplatCloud& cloud = bench.cloud;
  cloud.sh_rest_rows = kRestRows;
  const RandomStream random(kSeed, 0, RandomPurpose::synth);
  std::uint64_t number = 0;
  const auto uniform = [&] { return random.uniform(2 * number++); };
  const auto normal = [&] { return random.normal(number++); };
  for (std::size_t i = 0; i < size.splats; ++i) {
    const double z = kNearest * std::pow(kFarthest / kNearest, uniform());
    const double to_world = z / static_cast<double>(camera.fx);
    cloud.means.push_back(static_cast<float>((uniform() - 0.5) * size.width * to_world));
    cloud.means.push_back(static_cast<float>((uniform() - 0.5) * size.height * to_world));
    cloud.means.push_back(static_cast<float>(z));
    for (int axis = 0; axis < 3; ++axis) {
      cloud.log_scales.push_back(static_cast<float>(std::log(size.deviation * to_world) + kDeviationSpread * normal()));
    }
    for (int k = 0; k < 4; ++k) cloud.rotations.push_back(static_cast<float>(normal()));
    const double u = uniform();
    const double opacity = 0.003 + 0.99 * u * u * u;  // most are faint, as in a trained model
    cloud.logit_opacities.push_back(static_cast<float>(std::log(opacity / (1 - opacity))));
    for (int k = 0; k < 3; ++k) cloud.sh_dc.push_back(static_cast<float>(0.8 * normal()));
    for (int k = 0; k < 3 * kRestRows; ++k) cloud.sh_rest.push_back(static_cast<float>(0.1 * normal()));
  }
  for (const float x : cloud.log_scales) bench.scales.push_back(std::exp(x));
  for (const float x : cloud.logit_opacities) bench.opacities.push_back(1.0f / (1.0f + std::exp(-x)));
  bench.scene.points = {{cloud.means.begin(), cloud.means.begin() + 3}, {128, 128, 128}};  // replaced by the cloud
  return bench;
}

}  // namespace splatboost
