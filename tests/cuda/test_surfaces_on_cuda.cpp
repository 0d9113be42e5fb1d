// SPDX-License-Identifier: Apache-2.0
// Planes, surface depth and losses, exposure and observation statistics on a CUDA device, against the CPU.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "cuda/cuda_device.h"
#include "splatboost/density_statistics.h"
#include "splatboost/device_array.h"
#include "splatboost/exposure.h"
#include "splatboost/gaussian_planes.h"
#include "splatboost/surface_depth.h"
#include "splatboost/surface_loss.h"
#include "support/surface_scene.h"

namespace splatboost::test {
namespace {

using CudaSurfaces = OnCuda<>;
using testing::SurfaceScene;

void expect_near(const std::vector<float>& found, const std::vector<float>& expected, float relative) {
  ASSERT_EQ(found.size(), expected.size());
  float largest = 0;
  for (const float value : expected) largest = std::max(largest, std::abs(value));
  for (std::size_t i = 0; i < found.size(); ++i) ASSERT_NEAR(found[i], expected[i], relative * largest) << i;
}

template <class T>
std::span<const T> read(const DeviceArray<T>& array) {
  return array.span();
}

TEST_F(CudaSurfaces, planes_and_flatness_are_those_of_the_cpu) {
  constexpr std::size_t kCount = 300;
  const RandomStream random(4, 0, RandomPurpose::synth);
  std::uint64_t next = 0;
  std::vector<float> means, scales, rotations, upstream;
  std::vector<std::uint8_t> visible;
  for (std::size_t i = 0; i < kCount; ++i) {
    for (int c = 0; c < 3; ++c) means.push_back(static_cast<float>(random.normal(next++)));
    for (int c = 0; c < 3; ++c) scales.push_back(static_cast<float>(0.1 + random.uniform(next++)));
    for (int c = 0; c < 4; ++c) rotations.push_back(static_cast<float>(random.normal(next++)));
    for (int c = 0; c < 4; ++c) upstream.push_back(i % 3 == 0 ? 0 : static_cast<float>(random.normal(next++)));
    visible.push_back(i % 4 != 0);
  }
  const Camera camera = testing::camera_looking_at_origin({3, -1, 2}, 40, 30);
  Gaussians gaussians;
  gaussians.count = kCount;
  gaussians.means = means;
  gaussians.scales = scales;
  gaussians.rotations = rotations;
  Threads threads(2);
  std::vector<float> planes(4 * kCount), g_means(3 * kCount, 1), g_rotations(4 * kCount, 1), g_scales(3 * kCount, 1);
  std::vector<double> sums(2);
  gaussian_planes(gaussians, camera, planes, threads);
  gaussian_planes_backward(gaussians, camera, upstream, g_means, g_rotations, threads);
  flatness_loss(scales, visible, 10, sums, threads);
  flatness_loss_backward(scales, visible, 10, sums, g_scales, threads);

  const DeviceArray<float> d_means(stream(), means), d_scales(stream(), scales), d_rotations(stream(), rotations),
      d_upstream(stream(), upstream);
  const DeviceArray<std::uint8_t> d_visible(stream(), visible);
  DeviceArray<float> d_planes(stream(), planes), d_g_means(stream(), std::vector<float>(3 * kCount, 1)),
      d_g_rotations(stream(), std::vector<float>(4 * kCount, 1)),
      d_g_scales(stream(), std::vector<float>(3 * kCount, 1));
  DeviceArray<double> d_sums(stream(), std::vector<double>(2, 7.0));
  gaussians.means = d_means.span();
  gaussians.scales = d_scales.span();
  gaussians.rotations = d_rotations.span();
  gaussian_planes(gaussians, camera, d_planes.span(), stream());
  gaussian_planes_backward(gaussians, camera, d_upstream.span(), d_g_means.span(), d_g_rotations.span(), stream());
  flatness_loss(d_scales.span(), d_visible.span(), 10, d_sums.span(), stream());
  flatness_loss_backward(d_scales.span(), d_visible.span(), 10, read(d_sums), d_g_scales.span(), stream());
  expect_near(d_planes.to_host(), planes, 1e-5f);
  expect_near(d_g_means.to_host(), g_means, 1e-5f);
  expect_near(d_g_rotations.to_host(), g_rotations, 1e-5f);
  expect_near(d_g_scales.to_host(), g_scales, 1e-6f);
  EXPECT_NEAR(d_sums.to_host()[0], sums[0], 1e-5 * sums[0]);
  EXPECT_EQ(d_sums.to_host()[1], sums[1]);
}

void expect_losses_of_the_cpu(const SurfaceScene& scene, CudaStream& stream, const SurfaceTerms& terms = {}) {
  Threads threads(2);
  std::vector<float> expected[2];
  for (auto& g : expected) g.assign(scene.planes[0].size(), 0.0f);
  const SurfaceView first = scene.view(0, expected[0]), second = scene.view(1, expected[1]);
  const SurfaceLossParts parts = SurfaceLoss(threads).add(first, &second, terms, scene.random());

  SurfaceLoss loss(stream);
  SurfaceLossParts found;
  for (int round = 0; round < 3; ++round) {
    DeviceArray<std::uint8_t> photos[2] = {{stream, scene.photos[0]}, {stream, scene.photos[1]}};
    DeviceArray<std::uint8_t> valid[2] = {{stream, scene.valid[0]}, {stream, scene.valid[1]}};
    DeviceArray<std::uint8_t> patch_photos[2] = {{stream, scene.patch_photos[0]}, {stream, scene.patch_photos[1]}};
    DeviceArray<float> planes[2] = {{stream, scene.planes[0]}, {stream, scene.planes[1]}};
    DeviceArray<float> alphas[2] = {{stream, scene.alphas[0]}, {stream, scene.alphas[1]}};
    DeviceArray<float> gradients[2] = {{stream, std::vector<float>(scene.planes[0].size(), 0.0f)},
                                       {stream, std::vector<float>(scene.planes[0].size(), 0.0f)}};
    const auto patches_of = [&](std::size_t v) {
      const Camera& camera = scene.patch_cameras[v];
      return PatchPhoto{camera, {camera.width, camera.height, patch_photos[v].span(), {}}};
    };
    const PatchPhoto patches[2] = {patches_of(0), patches_of(1)};
    const auto view = [&](std::size_t v) {
      return SurfaceView{
          scene.cameras[v],    {SurfaceScene::kWidth, SurfaceScene::kHeight, photos[v].span(), valid[v].span()},
          read(planes[v]),     read(alphas[v]),
          gradients[v].span(), scene.patches[v] ? &patches[v] : nullptr};
    };
    const SurfaceView one = view(0), other = view(1);
    found = loss.add(one, &other, terms, scene.random());
    stream.synchronize();
    for (std::size_t v = 0; v < 2; ++v) expect_near(gradients[v].to_host(), expected[v], 1e-4f);
  }
  // The parts are those of this call or of the one before, which are equal.
  EXPECT_NEAR(found.normal, parts.normal, 1e-5 * parts.normal);
  EXPECT_NEAR(found.geometric, parts.geometric, 1e-4 * parts.geometric);
  EXPECT_NEAR(found.photometric, parts.photometric, 1e-4 * parts.photometric);
}

TEST_F(CudaSurfaces, losses_and_gradients_are_those_of_the_cpu) {
  expect_losses_of_the_cpu(SurfaceScene(0.01), stream());
}

TEST_F(CudaSurfaces, losses_and_gradients_are_those_of_the_cpu_with_masks) {
  SurfaceScene scene(0.01);
  scene.mask_pixels();
  expect_losses_of_the_cpu(scene, stream());
}

TEST_F(CudaSurfaces, losses_and_gradients_are_those_of_the_cpu_with_other_photos_for_patches) {
  SurfaceScene scene(0.01);
  scene.take_patch_photos(40, 32);
  expect_losses_of_the_cpu(scene, stream());
}

TEST_F(CudaSurfaces, losses_and_gradients_are_those_of_the_cpu_with_fewer_patches_than_pixels) {
  SurfaceTerms terms;
  for (const int most : {40, 0}) {
    terms.max_patches = most;
    expect_losses_of_the_cpu(SurfaceScene(0.01), stream(), terms);
  }
}

TEST_F(CudaSurfaces, losses_and_gradients_are_those_of_the_cpu_without_near_points) {
  SurfaceTerms terms;
  terms.near_depth = 3.2f;  // among the scene's depths
  for (const int most : {terms.max_patches, 60}) {
    terms.max_patches = most;
    expect_losses_of_the_cpu(SurfaceScene(0.01), stream(), terms);
  }
}

TEST_F(CudaSurfaces, depth_and_normals_are_those_of_the_cpu) {
  const SurfaceScene scene(0.01);
  Threads threads(1);
  std::vector<float> depth(scene.pixels()), normals(3 * scene.pixels());
  plane_depth(scene.cameras[0], scene.planes[0], depth, threads);
  depth_normals(scene.cameras[0], depth, normals, threads);
  const DeviceArray<float> planes(stream(), scene.planes[0]);
  DeviceArray<float> d_depth(stream(), std::vector<float>(depth.size(), 9.0f)),
      d_normals(stream(), std::vector<float>(normals.size(), 9.0f));
  plane_depth(scene.cameras[0], planes.span(), d_depth.span(), stream());
  depth_normals(scene.cameras[0], read(d_depth), d_normals.span(), stream());
  expect_near(d_depth.to_host(), depth, 1e-5f);
  expect_near(d_normals.to_host(), normals, 1e-3f);
}

TEST_F(CudaSurfaces, exposure_is_that_of_the_cpu) {
  const SurfaceScene scene(0);
  std::vector<float> render(3 * scene.pixels());
  for (std::size_t k = 0; k < render.size(); ++k) render[k] = static_cast<float>(k % 17) / 17;
  std::vector<std::uint8_t> valid(scene.pixels(), 1);
  for (std::size_t p = 0; p < valid.size(); p += 5) valid[p] = 0;
  const std::vector<float> exposure{0.1f, -0.05f};
  Threads threads(1);
  std::vector<float> gradient(render.size(), 1), of_exposure{1, 2}, exposed(render.size());
  std::vector<double> sums(4);
  add_exposed_l1(render, {SurfaceScene::kWidth, SurfaceScene::kHeight, scene.photos[0], valid}, exposure, 0.8f,
                 gradient, of_exposure, sums, threads);
  expose(render, exposure, exposed, threads);

  const DeviceArray<float> d_render(stream(), render), d_exposure(stream(), exposure);
  const DeviceArray<std::uint8_t> d_photo(stream(), scene.photos[0]), d_valid(stream(), valid);
  DeviceArray<float> d_gradient(stream(), std::vector<float>(render.size(), 1)),
      d_of_exposure(stream(), std::vector<float>{1, 2}), d_exposed(stream(), exposed);
  DeviceArray<double> d_sums(stream(), std::vector<double>(4, 3.0));
  add_exposed_l1(d_render.span(), {SurfaceScene::kWidth, SurfaceScene::kHeight, d_photo.span(), d_valid.span()},
                 d_exposure.span(), 0.8f, d_gradient.span(), d_of_exposure.span(), d_sums.span(), stream());
  expose(d_render.span(), d_exposure.span(), d_exposed.span(), stream());
  expect_near(d_gradient.to_host(), gradient, 1e-6f);
  expect_near(d_of_exposure.to_host(), of_exposure, 1e-5f);
  expect_near(d_exposed.to_host(), exposed, 1e-6f);
  EXPECT_NEAR(d_sums.to_host()[0], sums[0], 1e-5);
}

TEST_F(CudaSurfaces, radii_are_kept_where_observed) {
  const std::vector<std::int32_t> radii{5, 9, 2, 7}, observed{1, 0, 3, 1}, largest{3, 3, 3, 3};
  const DeviceArray<std::int32_t> d_radii(stream(), radii), d_observed(stream(), observed);
  DeviceArray<std::int32_t> d_largest(stream(), largest);
  add_screen_radii(d_radii.span(), d_observed.span(), d_largest.span(), stream());
  EXPECT_EQ(d_largest.to_host(), (std::vector<std::int32_t>{5, 3, 3, 7}));
}

}  // namespace
}  // namespace splatboost::test
