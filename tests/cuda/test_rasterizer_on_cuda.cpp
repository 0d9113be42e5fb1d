// SPDX-License-Identifier: Apache-2.0
// What only concerns CUDA devices: agreement with the CPU, steady loops that neither wait nor allocate, views that
// exceed the allocated tile entries, orders of execution. Formulas are tested by the CPU's tests, built for CUDA.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <tuple>
#include <vector>

#include "cuda/cuda_device.h"
#include "splatboost/convex_rasterizer.h"
#include "splatboost/device_array.h"
#include "splatboost/errors.h"
#include "splatboost/rasterizer.h"
#include "splatboost/threads.h"
#include "support/compare.h"
#include "support/scenes.h"
#ifdef SPLATBOOST_CUDA_ON_CPU
#include "cuda_on_cpu.h"
#endif

namespace splatboost::test {
namespace {

using Doubles = std::vector<double>;

/// A scene with colours on the device, and its image and gradients.
struct SceneOnDevice {
  SceneOnDevice(CudaStream& stream, const SceneData& scene, const Camera& camera)
      : count(scene.count),
        means(stream, scene.means),
        scales(stream, scene.scales),
        rotations(stream, scene.rotations),
        opacities(stream, scene.opacities),
        colors(stream, scene.colors),
        image(stream),
        image_gradient(stream),
        g_means(stream),
        g_scales(stream),
        g_rotations(stream),
        g_opacities(stream),
        g_colors(stream),
        g_abs(stream),
        flagged(stream),
        counts(stream) {
    const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
    image.ensure(3 * pixels);
    image_gradient.upload(ImageGradientData(camera, 0, 9, {}).color);
    g_means.ensure(3 * count);
    g_scales.ensure(3 * count);
    g_rotations.ensure(4 * count);
    g_opacities.ensure(count);
    g_colors.ensure(3 * count);
    g_abs.ensure(2 * count);
    flagged.upload(std::vector<std::uint8_t>(pixels, 1));
    counts.upload(std::vector<std::int32_t>(count, 0));
  }

  Gaussians gaussians(std::size_t n) const {
    Gaussians g;
    g.count = n;
    g.means = means.span().first(3 * n);
    g.scales = scales.span().first(3 * n);
    g.rotations = rotations.span().first(4 * n);
    g.opacities = opacities.span().first(n);
    g.colors = colors.span().first(3 * n);
    return g;
  }
  void forward(Rasterizer& rasterizer, const Camera& camera, const RasterOptions& options) {
    RasterImages images;
    images.color = image.span();
    rasterizer.forward(camera, gaussians(count), options, images);
  }
  void expect_refused(Rasterizer& rasterizer) {
    EXPECT_THROW(backward(rasterizer), ArgumentError);
    EXPECT_THROW(rasterizer.count_flagged(std::as_const(flagged).span(), counts.span()), ArgumentError);
    EXPECT_THROW(rasterizer.count_observed(0.5f, counts.span()), ArgumentError);
    EXPECT_THROW(rasterizer.add_weights(counts.span()), ArgumentError);
  }
  void backward(Rasterizer& rasterizer) {
    RasterImageGradients driving;
    driving.color = std::as_const(image_gradient).span();
    GaussianGradients gradients;
    gradients.means = g_means.span();
    gradients.scales = g_scales.span();
    gradients.rotations = g_rotations.span();
    gradients.opacities = g_opacities.span();
    gradients.colors = g_colors.span();
    gradients.screen_means_abs = g_abs.span();
    rasterizer.backward(gaussians(count), driving, gradients);
  }

  std::size_t count;
  DeviceArray<float> means, scales, rotations, opacities, colors, image, image_gradient, g_means, g_scales, g_rotations,
      g_opacities, g_colors, g_abs;
  DeviceArray<std::uint8_t> flagged;
  DeviceArray<std::int32_t> counts;
};

SceneData many_splats(const Camera& camera, std::size_t count, double largest = 5) {
  SceneSpec spec;
  spec.count = count;
  spec.colors = true;
  spec.largest = largest;
  return random_scene(camera, spec, 71);
}

Doubles as_doubles(const std::vector<float>& values) { return {values.begin(), values.end()}; }

class RasterizerOnCuda : public OnCuda<::testing::TestWithParam<BoxPolicy>> {
 protected:
  RasterizerOnCuda() {
    options.box = GetParam();
    options.beta = 0.5f;
  }
  Camera camera = oblique_camera(117, 85);
  RasterOptions options;
};

TEST_P(RasterizerOnCuda, AgreesWithTheCpu) {
  const SceneData scene = many_splats(camera, 1500);
  Threads threads(2);
  Rasterizer on_cpu(threads);
  std::vector<float> image(3 * 117 * 85);
  on_cpu.forward(camera, scene.view(), options, color_only(image));
  GradientData gradients(scene);
  ImageGradientData driving(camera, 0, 9, {});
  RasterImageGradients color_alone;
  color_alone.color = driving.color;
  on_cpu.backward(scene.view(), color_alone, gradients.view());
  std::vector<std::int32_t> counts(scene.count, 0);
  on_cpu.count_flagged(std::vector<std::uint8_t>(117 * 85, 1), counts);

  SceneOnDevice on_device(stream(), scene, camera);
  Rasterizer on_cuda(stream());
  on_device.forward(on_cuda, camera, options);
  on_device.backward(on_cuda);
  on_cuda.count_flagged(std::as_const(on_device.flagged).span(), on_device.counts.span());

  // Rounding decides a few (pixel, splat) pairs at thresholds differently; each changes a value by at most 1/255.
  const std::vector<float> drawn = on_device.image.to_host();
  std::size_t apart = 0;
  for (std::size_t k = 0; k < drawn.size(); ++k) {
    EXPECT_NEAR(drawn[k], image[k], 0.01) << k;
    apart += std::abs(drawn[k] - image[k]) > 1e-5f ? 1 : 0;
  }
  EXPECT_TRUE(are_few(apart, drawn.size(), 0.002));
  const Tolerance tolerance{.relative = 1e-2, .scale = 1e-3, .absolute = 0, .l2 = 1e-3};
  EXPECT_TRUE(is_close(on_device.g_means.to_host(), as_doubles(gradients.means), tolerance));
  EXPECT_TRUE(is_close(on_device.g_scales.to_host(), as_doubles(gradients.scales), tolerance));
  EXPECT_TRUE(is_close(on_device.g_opacities.to_host(), as_doubles(gradients.opacities), tolerance));
  EXPECT_TRUE(is_close(on_device.g_colors.to_host(), as_doubles(gradients.colors), tolerance));
  EXPECT_TRUE(is_close(on_device.g_abs.to_host(), as_doubles(gradients.screen_means_abs), tolerance));
  const std::vector<std::int32_t> counted = on_device.counts.to_host();
  std::int64_t sum = 0, difference = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    sum += counts[i];
    difference += std::abs(counts[i] - counted[i]);
  }
  EXPECT_LE(difference, sum / 10000);
  EXPECT_EQ(on_cuda.counts().visible, on_cpu.counts().visible);
  EXPECT_NEAR(static_cast<double>(on_cuda.counts().tile_entries), static_cast<double>(on_cpu.counts().tile_entries), 2);
}

TEST_P(RasterizerOnCuda, ASteadyLoopNeitherWaitsNorAllocates) {
  const SceneData scene = many_splats(camera, 300);
  SceneOnDevice on_device(stream(), scene, camera);
  Rasterizer rasterizer(stream());
  const auto iteration = [&](int i) {
    Camera moved = camera;
    moved.cx += static_cast<float>(i % 3);
    on_device.forward(rasterizer, moved, options);
    on_device.backward(rasterizer);
    rasterizer.count_flagged(std::as_const(on_device.flagged).span(), on_device.counts.span());
  };
  for (int i = 0; i < 3; ++i) iteration(i);
  const CudaActivity before = stream().activity();
  for (int i = 0; i < 6; ++i) iteration(i);
  EXPECT_EQ(stream().activity().synchronizations, before.synchronizations);
  EXPECT_EQ(stream().activity().allocations, before.allocations);
  EXPECT_FALSE(rasterizer.settle());
}

TEST_P(RasterizerOnCuda, AViewThatOutgrowsItsRoomIsDrawnAgain) {
  const SceneData scene = many_splats(camera, 2500, 12);
  SceneOnDevice on_device(stream(), scene, camera);
  Rasterizer fresh(stream());
  on_device.forward(fresh, camera, options);  // its first view: exact
  EXPECT_FALSE(fresh.settle());
  const std::vector<float> expected = on_device.image.to_host();

  Camera away = camera;
  away.cx += 5000;
  for (const bool settles : {true, false}) {
    Rasterizer rasterizer(stream());
    on_device.forward(rasterizer, away, options);  // hardly anything is visible
    on_device.image.fill_zero();
    on_device.forward(rasterizer, camera, options);
    if (settles) {
      EXPECT_TRUE(rasterizer.settle());
      EXPECT_FALSE(rasterizer.settle());
    } else {
      EXPECT_NE(on_device.image.to_host(), expected);
      on_device.forward(rasterizer, camera, options);  // it now has enough room
    }
    EXPECT_EQ(on_device.image.to_host(), expected);
    EXPECT_EQ(rasterizer.counts().tile_entries, fresh.counts().tile_entries);
  }
}

TEST_P(RasterizerOnCuda, ALargerViewThanAllBeforeHasEnoughRoom) {
  Camera small = camera;
  small.width /= 4, small.height /= 4;
  small.fx /= 4, small.fy /= 4, small.cx /= 4, small.cy /= 4;
  const SceneData scene = many_splats(camera, 2500, 12);
  SceneOnDevice on_device(stream(), scene, camera), on_small(stream(), scene, small);
  Rasterizer fresh(stream()), rasterizer(stream());
  on_device.forward(fresh, camera, options);
  const std::vector<float> expected = on_device.image.to_host();
  on_small.forward(rasterizer, small, options);
  on_device.image.fill_zero();
  on_device.forward(rasterizer, camera, options);
  EXPECT_EQ(on_device.image.to_host(), expected);
  EXPECT_FALSE(rasterizer.settle());
}

TEST_P(RasterizerOnCuda, RoundGaussiansThatAreNotTurnedAreNotTurnedByRounding) {
  SceneData scene = many_splats(camera, 100);
  for (std::size_t i = 0; i < scene.count; ++i) {
    scene.scales[3 * i + 1] = scene.scales[3 * i + 2] = scene.scales[3 * i];
    for (std::size_t c = 0; c < 4; ++c) scene.rotations[4 * i + c] = c == 0 ? 1.0f : 0.0f;
  }
  SceneOnDevice on_device(stream(), scene, camera);
  Rasterizer rasterizer(stream());
  on_device.forward(rasterizer, camera, options);
  on_device.backward(rasterizer);
  EXPECT_EQ(on_device.g_rotations.to_host(), std::vector<float>(4 * scene.count, 0.0f));
}

#ifdef SPLATBOOST_CUDA_ON_CPU

TEST_P(RasterizerOnCuda, TheOrderOfThreadsAndBlocksChangesNoPixelAndNoCount) {
  const SceneData scene = many_splats(camera, 200);
  std::vector<std::vector<float>> images, slopes;
  std::vector<std::vector<std::int32_t>> counts;
  for (const std::uint64_t seed : {0u, 1u, 2u, 3u}) {
    cuda_on_cpu::permute(seed);
    SceneOnDevice on_device(stream(), scene, camera);
    Rasterizer rasterizer(stream());
    on_device.forward(rasterizer, camera, options);
    on_device.backward(rasterizer);
    rasterizer.count_flagged(std::as_const(on_device.flagged).span(), on_device.counts.span());
    images.push_back(on_device.image.to_host());
    slopes.push_back(on_device.g_means.to_host());
    counts.push_back(on_device.counts.to_host());
  }
  cuda_on_cpu::permute(1);
  const Tolerance rounding{.relative = 1e-5, .scale = 1e-6, .absolute = 0, .l2 = 1e-6};
  for (std::size_t k = 1; k < images.size(); ++k) {
    EXPECT_EQ(images[k], images[0]);
    EXPECT_EQ(counts[k], counts[0]);
    EXPECT_TRUE(is_close(slopes[k], as_doubles(slopes[0]), rounding));  // sums of floats in another order
  }
}

TEST_P(RasterizerOnCuda, TooLittleDeviceMemoryIsSaid) {
  const SceneData scene = many_splats(camera, 300);
  SceneOnDevice on_device(stream(), scene, camera);
  Rasterizer rasterizer(stream());
  cuda_on_cpu::set_device_memory(cuda_on_cpu::device_memory_in_use() + 1000);
  EXPECT_THROW(on_device.forward(rasterizer, camera, options), DeviceMemoryError);
  cuda_on_cpu::set_device_memory(std::size_t{4} << 30);
  on_device.forward(rasterizer, camera, options);  // works again when memory is available
  EXPECT_GT(rasterizer.counts().visible, 0u);
}

/// Allocations that fail at different stages: of the visible Gaussians, of the tile lists.
constexpr std::size_t kTooLittle[] = {1000, 100000};

TEST_P(RasterizerOnCuda, AViewThatDoesNotFitIsRefusedAndForgotten) {
  const SceneData scene = many_splats(camera, 2500, 12);
  Camera away = camera;
  away.cx += 5000;
  for (const std::size_t more : kTooLittle) {
    SCOPED_TRACE(more);
    SceneOnDevice on_device(stream(), scene, camera);
    Rasterizer rasterizer(stream());
    on_device.forward(rasterizer, away, options);  // hardly anything is visible
    on_device.backward(rasterizer);
    on_device.forward(rasterizer, camera, options);  // does not wait
    stream().synchronize();
    cuda_on_cpu::set_device_memory(cuda_on_cpu::device_memory_in_use() + more);
    EXPECT_THROW(on_device.forward(rasterizer, camera, options), DeviceMemoryError);
    on_device.expect_refused(rasterizer);
    EXPECT_FALSE(rasterizer.settle());
    EXPECT_EQ(rasterizer.counts().tile_entries, 0u);
    EXPECT_NO_THROW(on_device.forward(rasterizer, away, options));
    EXPECT_NO_THROW(on_device.backward(rasterizer));
    cuda_on_cpu::set_device_memory(std::size_t{4} << 30);
  }
}

TEST_P(RasterizerOnCuda, ASettleThatFailsIsRepeated) {
  const SceneData scene = many_splats(camera, 2500, 12);
  SceneOnDevice on_device(stream(), scene, camera);
  Rasterizer fresh(stream());
  on_device.forward(fresh, camera, options);
  const std::vector<float> expected = on_device.image.to_host();
  Camera away = camera;
  away.cx += 5000;
  for (const std::size_t more : kTooLittle) {
    SCOPED_TRACE(more);
    Rasterizer rasterizer(stream());
    on_device.forward(rasterizer, away, options);
    on_device.forward(rasterizer, camera, options);  // too little room
    cuda_on_cpu::set_device_memory(cuda_on_cpu::device_memory_in_use() + more);
    EXPECT_THROW(rasterizer.settle(), DeviceMemoryError);
    on_device.expect_refused(rasterizer);
    EXPECT_THROW(rasterizer.counts(), DeviceMemoryError);
    cuda_on_cpu::set_device_memory(std::size_t{4} << 30);
    EXPECT_TRUE(rasterizer.settle());
    EXPECT_FALSE(rasterizer.settle());
    EXPECT_EQ(on_device.image.to_host(), expected);
    EXPECT_EQ(rasterizer.counts().tile_entries, fresh.counts().tile_entries);
  }
}

using LargeViewsOnCuda = OnCuda<::testing::Test>;

TEST_F(LargeViewsOnCuda, MorePairsThan32BitsHoldAreRefused) {
  constexpr std::size_t kGaussians = 263000;
  Camera camera;
  camera.width = camera.height = 2048;  // 128 × 128 tiles: 2^32 + 14 million pairs
  camera.fx = camera.fy = 2000;
  camera.cx = camera.cy = 1024;
  SceneData scene;
  scene.count = kGaussians;
  for (std::size_t i = 0; i < kGaussians; ++i) {
    scene.means.insert(scene.means.end(), {0, 0, 2});
    scene.rotations.insert(scene.rotations.end(), {1, 0, 0, 0});
  }
  scene.scales.assign(3 * kGaussians, 2);
  scene.opacities.assign(kGaussians, 0.5f);
  scene.colors.assign(3 * kGaussians, 0.5f);
  SceneOnDevice on_device(stream(), scene, camera);
  RasterOptions options;
  options.box = BoxPolicy::square;
  Rasterizer rasterizer(stream());
  EXPECT_THROW(on_device.forward(rasterizer, camera, options), ArgumentError);
  Camera away = camera;
  away.width = away.height = 16;
  away.cx += 1e6f;
  SceneOnDevice elsewhere(stream(), scene, away);
  EXPECT_NO_THROW(elsewhere.forward(rasterizer, away, options));
  EXPECT_EQ(rasterizer.counts().tile_entries, 0u);
}

using ConvexesOnCuda = OnCuda<::testing::Test>;

TEST_F(ConvexesOnCuda, AViewThatDoesNotFitIsRefused) {
  constexpr std::size_t kPixels = 40 * 36;
  Camera camera;
  camera.width = 40;
  camera.height = 36;
  camera.fx = camera.fy = 60;
  camera.cx = 20;
  camera.cy = 18;
  const std::vector<float> corners{-0.2f, -0.2f, 2, 0.2f, -0.2f, 2, 0.2f, 0.2f, 2};
  const DeviceArray<float> points(stream(), corners), smoothness(stream(), std::vector<float>{0.1f}),
      sharpness(stream(), std::vector<float>{0.05f}), opacities(stream(), std::vector<float>{0.8f}),
      colors(stream(), std::vector<float>{1, 0.5f, 0.25f}), gradient(stream(), std::vector<float>(3 * kPixels, 1.0f));
  DeviceArray<float> image(stream()), g_points(stream());
  image.ensure(3 * kPixels);
  g_points.ensure(corners.size());
  Convexes convexes;
  convexes.count = 1;
  convexes.points_per_convex = 3;
  convexes.points = points.span();
  convexes.smoothness = smoothness.span();
  convexes.sharpness = sharpness.span();
  convexes.opacities = opacities.span();
  convexes.colors = colors.span();
  ConvexGradients gradients;
  gradients.points = g_points.span();

  ConvexRasterizer rasterizer(stream());
  Convexes nothing;
  nothing.points_per_convex = 3;
  rasterizer.forward(camera, nothing, {}, image.span());
  cuda_on_cpu::set_device_memory(cuda_on_cpu::device_memory_in_use());
  EXPECT_THROW(rasterizer.forward(camera, convexes, {}, image.span()), DeviceMemoryError);
  cuda_on_cpu::set_device_memory(std::size_t{4} << 30);
  EXPECT_THROW(rasterizer.backward(convexes, gradient.span(), {}, gradients), ArgumentError);
  EXPECT_EQ(rasterizer.counts().visible, 0u);
  rasterizer.forward(camera, convexes, {}, image.span());
  EXPECT_NO_THROW(rasterizer.backward(convexes, gradient.span(), {}, gradients));
  EXPECT_EQ(rasterizer.counts().visible, 1u);
}

#endif

INSTANTIATE_TEST_SUITE_P(Kinds, RasterizerOnCuda, ::testing::Values(BoxPolicy::square, BoxPolicy::ellipse),
                         [](const auto& given) {
                           return std::string(given.param == BoxPolicy::square ? "square" : "ellipse");
                         });

}  // namespace
}  // namespace splatboost::test
