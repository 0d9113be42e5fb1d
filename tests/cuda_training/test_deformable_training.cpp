// SPDX-License-Identifier: Apache-2.0
// Deformable-3DGS on a CUDA device: its deformation field against the CPU's, and whole runs.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "cuda_training/training_runs.h"
#include "deformable_3dgs/deformable_3dgs.h"
#include "deformable_3dgs/deformation_field.h"
#include "splatboost/array.h"
#include "support/toy_methods.h"

namespace splatboost::test {
namespace {

class CudaDeformation : public OnCuda<::testing::TestWithParam<DeformationShape>> {
 protected:
  static std::vector<float> random_values(std::size_t n, std::uint64_t seed, double scale) {
    const RandomStream random(seed, 0, RandomPurpose::net_parameters);
    std::vector<float> values(n);
    for (std::size_t i = 0; i < n; ++i) values[i] = static_cast<float>(scale * random.normal(i));
    return values;
  }

  /// The deformed parameters, then all gradients.
  static std::vector<std::vector<float>> outcome(const DeformationShape& shape, Device device) {
    constexpr std::size_t kCount = 300;
    const std::vector<float> start = initial_deformation(shape, RandomStream(1, 0, RandomPurpose::net_parameters));
    const Array<float> p(device, start), means(device, random_values(3 * kCount, 2, 1)),
        scales(device, random_values(3 * kCount, 3, 1)), rotations(device, random_values(4 * kCount, 4, 1));
    const Array<float> by_means(device, random_values(3 * kCount, 5, 1)),
        by_scales(device, random_values(3 * kCount, 6, 1)), by_rotations(device, random_values(4 * kCount, 7, 1));
    std::vector<Array<float>> out;
    const std::size_t sizes[] = {3 * kCount, 3 * kCount, 4 * kCount, 3 * kCount, 3 * kCount, 4 * kCount, start.size()};
    for (const std::size_t size : sizes) out.emplace_back(device, std::vector<float>(size, 0.5f));  // accumulate
    DeformationField field(shape, device);
    const GaussianPlaces<const float> at{means, scales, rotations};
    field.forward(p, at, 0.9f, {out[0], out[1], out[2]}, false);  // must not affect the next call
    field.forward(p, at, 0.3f, {out[0], out[1], out[2]}, true);
    field.backward(p, at, {by_means, by_scales, by_rotations}, {out[3], out[4], out[5]}, out[6]);
    std::vector<std::vector<float>> found;
    for (const Array<float>& array : out) found.push_back(array.to_host());
    return found;
  }
};

TEST_P(CudaDeformation, IsThatOfTheCpu) {
  Threads threads(1);
  const auto found = outcome(GetParam(), stream()), expected = outcome(GetParam(), threads);
  for (std::size_t k = 0; k < expected.size(); ++k) {
    float largest = 0;
    for (const float value : expected[k]) largest = std::max(largest, std::abs(value));
    for (std::size_t i = 0; i < expected[k].size(); ++i) {
      ASSERT_NEAR(found[k][i], expected[k][i], 2e-5f * largest) << "array " << k << " at " << i;
    }
  }
}

#ifdef SPLATBOOST_CUDA_ON_CPU
TEST_P(CudaDeformation, NamesTheMemoryThatCublasDidNotFind) {
  const std::vector<float> start = initial_deformation(GetParam(), RandomStream(1, 0, RandomPurpose::net_parameters));
  const Array<float> p(stream(), start), means(stream(), random_values(30, 2, 1)),
      scales(stream(), random_values(30, 3, 1)), rotations(stream(), random_values(40, 4, 1));
  Array<float> moved(stream(), std::vector<float>(30)), scaled(stream(), std::vector<float>(30)),
      turned(stream(), std::vector<float>(40));
  DeformationField field(GetParam(), stream());
  const auto draw = [&] { field.forward(p, {means, scales, rotations}, 0.3f, {moved, scaled, turned}, false); };
  draw();  // allocates the memory of our own
  cuda_on_cpu::set_device_memory(cuda_on_cpu::device_memory_in_use());
  std::string message;
  try {
    draw();
  } catch (const DeviceMemoryError& error) {
    message = error.what();
  }
  cuda_on_cpu::set_device_memory(std::size_t{4} << 30);
  EXPECT_NE(message.find("out of device memory: cublasSgemm, 0 of "), std::string::npos) << message;
  draw();
}
#endif

DeformationShape shape_of(bool rigid, bool time_net) {
  DeformationShape shape;
  shape.rigid = rigid;
  shape.time_net = time_net;
  shape.layers = 3;
  shape.width = 24;
  return shape;
}

INSTANTIATE_TEST_SUITE_P(Shapes, CudaDeformation, ::testing::Values(shape_of(false, true), shape_of(true, false)));

Method deformable(const char* name, bool rigid) {
  return {name,
          [rigid](const BackboneContext& c) {
            DeformableConfig config;
            config.net_layers = 3;
            config.net_width = 16;
            config.densify_interval = 4;
            config.position_rate_scale = 1;
            config.is_6dof = rigid;
            return make_deformable(c, config);
          },
          nullptr};
}

class CudaDeformable : public TrainingOnCuda {
 protected:
  CudaDeformable() : TrainingOnCuda(36) { testing::spread_times(scene_); }
};

TEST_P(CudaDeformable, TrainsAsOnTheCpu) {
  const Trace expected = whole_run(threads_, false);
  EXPECT_GT(expected.primitives.back(), scene_.points.size()) << "this run shall grow";
  expect_same_run(whole_run(stream(), false), expected, 3);
}

TEST_P(CudaDeformable, NeverWaitsBetweenGrowths) { expect_no_wait_between_growths(16); }

TEST_P(CudaDeformable, GoesOnFromACheckpointOnEitherDevice) { expect_resume_on_either_device(17, 22, 2); }

TEST_P(CudaDeformable, ModelsAndPicturesAreThoseOfTheCpu) { expect_models_and_pictures_of_the_cpu(10); }

INSTANTIATE_TEST_SUITE_P(Motions, CudaDeformable, ::testing::Values(deformable("rigid", true)),
                         [](const auto& method) { return method.param.name; });

}  // namespace
}  // namespace splatboost::test
