// SPDX-License-Identifier: Apache-2.0
// Depth and normals of planes, and the losses of one and two views: values against a direct implementation in double,
// gradients against its finite differences.
#include "splatboost/surface_loss.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/mat4x4.hpp>

#include "splatboost/exposure.h"
#include "splatboost/surface_depth.h"
#include "support/instruction_sets.h"
#include "support/surface_scene.h"

namespace splatboost {
namespace {

using testing::Frozen;
using testing::plain_surface_loss;
using testing::SurfaceScene;

TEST(PlaneDepth, lies_where_rays_meet_the_plane) {
  const SurfaceScene scene(0);
  Threads threads(2);
  std::vector<float> depth(scene.pixels());
  plane_depth(scene.cameras[0], scene.planes[0], depth, threads);
  const glm::dmat4 world_from_camera = glm::inverse(glm::dmat4(scene.cameras[0].camera_from_world));
  for (std::size_t p = 0; p < scene.pixels(); ++p) {
    const glm::dvec3 ray = testing::ray_of(scene.cameras[0], p);
    const glm::dvec4 point = world_from_camera * glm::dvec4(static_cast<double>(depth[p]) * ray, 1);
    EXPECT_NEAR(glm::dot(scene.normal, glm::dvec3(point)), scene.offset, 1e-5) << p;
  }
  std::vector<float> normals(3 * scene.pixels());
  depth_normals(scene.cameras[0], depth, normals, threads);
  const glm::dvec3 expected = glm::dmat3(scene.cameras[0].rotation()) * scene.normal;
  const std::size_t middle = 5 * SurfaceScene::kWidth + 7;
  for (std::size_t c = 0; c < 3; ++c) {
    EXPECT_NEAR(normals[c * scene.pixels() + middle], expected[static_cast<int>(c)], 1e-4);
    EXPECT_EQ(normals[c * scene.pixels() + 3], 0) << "none on the border";
  }
}

TEST(PlaneDepth, is_zero_where_nothing_faces_the_camera) {
  const SurfaceScene scene(0);
  Threads threads(1);
  std::vector<float> planes(4 * scene.pixels(), 0.0f), depth(scene.pixels()), gradients(planes.size(), 0.0f);
  planes[2 * scene.pixels() + 1] = 1;  // faces away from the camera
  planes[3 * scene.pixels() + 1] = 1;
  plane_depth(scene.cameras[0], planes, depth, threads);
  EXPECT_EQ(depth, std::vector<float>(scene.pixels(), 0.0f));
  plane_depth_backward(scene.cameras[0], planes, std::vector<float>(scene.pixels(), 1.0f), gradients, threads);
  EXPECT_EQ(gradients, std::vector<float>(planes.size(), 0.0f));
}

/// Depths that a comparison of the two views reads for each pixel of the first: of its point in the first view and in
/// the second, of the second view's surface there, and of that surface in the first view. Infinite outside the second.
std::vector<std::array<double, 4>> compared_depths(const SurfaceScene& scene) {
  const Camera &a = scene.cameras[0], &b = scene.cameras[1];
  const auto depth_of = [&](std::size_t v, std::size_t p) {
    const std::vector<float>& planes = scene.planes[v];
    const glm::dvec3 blended(planes[p], planes[scene.pixels() + p], planes[2 * scene.pixels() + p]);
    return -static_cast<double>(planes[3 * scene.pixels() + p]) /
           glm::dot(blended, testing::ray_of(scene.cameras[v], p));
  };
  const auto moved = [](const Camera& to, const Camera& from, const glm::dvec3& point) {
    return glm::dvec3(glm::dmat4(to.camera_from_world) * glm::inverse(glm::dmat4(from.camera_from_world)) *
                      glm::dvec4(point, 1));
  };
  std::vector<std::array<double, 4>> depths(scene.pixels());
  for (std::size_t p = 0; p < scene.pixels(); ++p) {
    depths[p].fill(std::numeric_limits<double>::infinity());
    const glm::dvec3 there = moved(b, a, depth_of(0, p) * testing::ray_of(a, p));
    const double ray_x = there.x / there.z, ray_y = there.y / there.z;
    const double x = static_cast<double>(b.fx) * ray_x + static_cast<double>(b.cx);
    const double y = static_cast<double>(b.fy) * ray_y + static_cast<double>(b.cy);
    if (!(x >= 0 && y >= 0 && x < b.width && y < b.height)) continue;
    double found = 0;  // bilinear; texels outside the image are those of its border
    for (int row = 0; row < b.height; ++row) {
      for (int column = 0; column < b.width; ++column) {
        const double across = std::clamp(x - 0.5, 0.0, b.width - 1.0), down = std::clamp(y - 0.5, 0.0, b.height - 1.0);
        const double weight = std::max(0.0, 1 - std::abs(across - column)) * std::max(0.0, 1 - std::abs(down - row));
        if (weight > 0) found += weight * depth_of(1, static_cast<std::size_t>(row * b.width + column));
      }
    }
    depths[p] = {depth_of(0, p), there.z, found, moved(a, b, found * glm::dvec3(ray_x, ray_y, 1)).z};
  }
  return depths;
}

/// Leaves out of the comparison of views the pixels with anything nearer.
void leave_out_nearer(const SurfaceScene& scene, float near_depth, Frozen& frozen) {
  const auto limit = static_cast<double>(near_depth);
  const std::vector<std::array<double, 4>> depths = compared_depths(scene);
  std::array<int, 4> left_out_by{};
  for (std::size_t p = 0; p < depths.size(); ++p) {
    if (frozen.weights[p] == 0) continue;
    std::size_t nearer = 0, which = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      ASSERT_GT(std::abs(depths[p][k] - limit), 1e-5) << "rounding would decide about pixel " << p;
      if (depths[p][k] > limit) continue;
      ++nearer;
      which = k;
    }
    if (nearer == 0) continue;
    if (nearer == 1) ++left_out_by[which];
    frozen.weights[p] = 0;
    frozen.agreeing -= 1;
    frozen.patches -= frozen.counts[p];
    frozen.counts[p] = 0;
  }
  for (const int pixels : left_out_by) EXPECT_GT(pixels, 0) << "none is left out by only one of the depths";
}

/// Leaves only those patches that are drawn: each with the same probability, so that about `most` pixels are.
void leave_drawn_patches(int most, const RandomStream& random, Frozen& frozen) {
  for (std::size_t p = 0; p < frozen.counts.size(); ++p) {
    if (frozen.counts[p] == 0 || random.uniform(p) < most / frozen.agreeing) continue;
    frozen.counts[p] = 0;
    frozen.patches -= 1;
  }
}

struct Case {
  const char* name = "";
  float normal = 0, geometric = 0, photometric = 0;
  int patch_width = SurfaceScene::kWidth, patch_height = SurfaceScene::kHeight;  ///< size of the photos of patches
  bool masked = false;
  int max_patches = SurfaceTerms().max_patches;
  float near_depth = SurfaceTerms().near_depth;
};
class SurfaceLossCase : public ::testing::TestWithParam<Case> {};

TEST_P(SurfaceLossCase, is_that_of_the_plain_restatement_with_its_finite_differences) {
  SurfaceScene scene(0.01);
  if (GetParam().patch_width != SurfaceScene::kWidth) {
    scene.take_patch_photos(GetParam().patch_width, GetParam().patch_height);
  }
  if (GetParam().masked) scene.mask_pixels();
  SurfaceTerms terms;
  terms.normal_weight = GetParam().normal;
  terms.geometric_weight = GetParam().geometric;
  terms.photometric_weight = GetParam().photometric;
  terms.max_patches = GetParam().max_patches;
  terms.near_depth = GetParam().near_depth;
  std::vector<double> planes[2];
  for (std::size_t v = 0; v < 2; ++v) planes[v].assign(scene.planes[v].begin(), scene.planes[v].end());
  Frozen frozen;
  double expected = plain_surface_loss(scene, planes[0], planes[1], terms, frozen);
  ASSERT_TRUE(frozen.set);
  const bool far_only = terms.near_depth > Case().near_depth, some_patches = terms.max_patches < Case().max_patches;
  if (far_only || some_patches) {
    const double of_all = expected;
    if (far_only) leave_out_nearer(scene, terms.near_depth, frozen);
    if (some_patches) leave_drawn_patches(terms.max_patches, scene.random(), frozen);
    expected = plain_surface_loss(scene, planes[0], planes[1], terms, frozen);
    EXPECT_GT(std::abs(expected - of_all), 0.01 * of_all) << "those that are left out make a difference";
    EXPECT_LT(frozen.patches, 1.5 * terms.max_patches);
  }
  if (terms.geometric_weight > 0) {
    EXPECT_GT(frozen.agreeing, 50);
  }
  if (terms.photometric_weight > 0) {
    EXPECT_GT(frozen.patches, 20);
  }

  const RandomStream random(5, 0, RandomPurpose::synth);
  std::uint64_t next = 0;
  std::vector<std::pair<std::size_t, double>> slopes[2];  // gradients of some elements: index and value
  for (std::size_t v = 0; v < 2; ++v) {
    for (int trial = 0; trial < 60; ++trial) {
      const std::size_t k = random.below(next++, planes[v].size());
      const double at = planes[v][k], step = 1e-7;
      planes[v][k] = at + step;
      const double up = plain_surface_loss(scene, planes[0], planes[1], terms, frozen);
      planes[v][k] = at - step;
      const double down = plain_surface_loss(scene, planes[0], planes[1], terms, frozen);
      planes[v][k] = at;
      slopes[v].emplace_back(k, (up - down) / (2 * step));
    }
  }

  const double tolerance = some_patches ? 4e-4 : 1e-4;  // rounding errors of few patches cancel less
  test::for_each_target([&] {
    Threads threads(2);
    SurfaceLoss loss(threads);
    std::vector<float> gradients[2];
    for (auto& g : gradients) g.assign(scene.planes[0].size(), 0.0f);
    const SurfaceView first = scene.view(0, gradients[0]), second = scene.view(1, gradients[1]);
    const double found = loss.add(first, &second, terms, scene.random()).total();
    EXPECT_NEAR(found, expected, tolerance * expected);
    for (std::size_t v = 0; v < 2; ++v) {
      float largest = 0;
      for (const float g : gradients[v]) largest = std::max(largest, std::abs(g));
      if (v == 0 || terms.geometric_weight > 0) {
        EXPECT_GT(largest, 0);
      }
      for (const auto& [k, slope] : slopes[v]) {
        EXPECT_NEAR(gradients[v][k], slope, 2e-3 * static_cast<double>(largest) + 1e-8)
            << "view " << v << " number " << k;
      }
    }
  });
}

INSTANTIATE_TEST_SUITE_P(
    Terms, SurfaceLossCase,
    ::testing::Values(
        Case{"normal", 0.5f, 0, 0}, Case{"geometric", 0, 0.5f, 0}, Case{"photometric", 0, 0, 0.5f},
        Case{"finer_photos", 0, 0, 0.5f, 40, 32}, Case{"coarser_photos", 0, 0, 0.5f, 13, 11},
        Case{"all", 0.015f, 0.03f, 0.15f},
        Case{"masked", 0.015f, 0.03f, 0.15f, SurfaceScene::kWidth, SurfaceScene::kHeight, true},
        Case{.name = "some_patches", .photometric = 0.5f, .max_patches = 40},
        Case{.name = "some_far_patches", .photometric = 0.5f, .max_patches = 60, .near_depth = 3.2f},
        Case{.name = "far_only", .normal = 0.015f, .geometric = 0.03f, .photometric = 0.15f, .near_depth = 3.2f}),
    [](const auto& tested) { return tested.param.name; });

TEST(SurfaceLossRun, gives_the_same_bytes_for_any_number_of_threads_and_again) {
  const SurfaceScene scene(0.01);
  std::vector<float> before[2];
  double before_loss = 0;
  for (const int count : {1, 3}) {
    Threads threads(count);
    SurfaceLoss loss(threads);
    for (int round = 0; round < 2; ++round) {
      std::vector<float> gradients[2];
      for (auto& g : gradients) g.assign(scene.planes[0].size(), 0.0f);
      const SurfaceView first = scene.view(0, gradients[0]), second = scene.view(1, gradients[1]);
      const double found = loss.add(first, &second, {}, scene.random()).total();
      if (!before[0].empty()) {
        EXPECT_EQ(found, before_loss);
        EXPECT_EQ(gradients[0], before[0]);
        EXPECT_EQ(gradients[1], before[1]);
      }
      before_loss = found;
      before[0] = gradients[0];
      before[1] = gradients[1];
    }
  }
}

TEST(SurfaceLossRun, compares_no_photo_with_a_camera_that_has_none) {
  SurfaceScene scene(0.01);
  scene.photos[1].clear();
  Threads threads(1);
  SurfaceLoss loss(threads);
  std::vector<float> gradients[2];
  for (auto& g : gradients) g.assign(scene.planes[0].size(), 0.0f);
  const SurfaceView first = scene.view(0, gradients[0]), second = scene.view(1, gradients[1]);
  const SurfaceLossParts parts = loss.add(first, &second, {}, scene.random());
  EXPECT_EQ(parts.photometric, 0);
  EXPECT_GT(parts.geometric, 0);
}

TEST(SurfaceLossRun, takes_views_that_have_only_a_border) {
  for (const auto& [width, height] : {std::pair{1, 8}, {2, 8}, {8, 1}, {8, 2}, {1, 1}, {2, 2}}) {
    const Camera camera = testing::camera_looking_at_origin({3, -0.5f, 1.2f}, width, height);
    const auto pixels = static_cast<std::size_t>(width * height);
    std::vector<std::uint8_t> photo(3 * pixels);
    for (std::size_t k = 0; k < photo.size(); ++k) photo[k] = static_cast<std::uint8_t>(37 * k);
    std::vector<float> planes(4 * pixels, 0.0f), gradients(planes.size(), 0.0f);
    const std::vector<float> alpha(pixels, 1.0f);
    for (std::size_t p = 0; p < pixels; ++p) {
      planes[2 * pixels + p] = -1;
      planes[3 * pixels + p] = 2;
    }
    Threads threads(1);
    SurfaceLoss loss(threads);
    const SurfaceView view{camera, {width, height, photo, {}}, planes, alpha, gradients};
    EXPECT_EQ(loss.add(view, nullptr, {}, SurfaceScene::random()).normal, 0) << width << " x " << height;
    EXPECT_EQ(gradients, std::vector<float>(planes.size(), 0.0f)) << width << " x " << height;
  }
}

TEST(SurfaceLossRun, compares_no_patch_if_it_may_compare_none) {
  const SurfaceScene scene(0.01);
  SurfaceTerms terms;
  terms.max_patches = 0;
  Threads threads(1);
  SurfaceLoss loss(threads);
  std::vector<float> gradients[2];
  for (auto& g : gradients) g.assign(scene.planes[0].size(), 0.0f);
  const SurfaceView first = scene.view(0, gradients[0]), second = scene.view(1, gradients[1]);
  EXPECT_EQ(loss.add(first, &second, terms, scene.random()).photometric, 0);
}

TEST(ExposedL1, gradient_is_that_of_finite_differences) {
  const RandomStream random(9, 0, RandomPurpose::synth);
  std::uint64_t next = 0;
  constexpr std::size_t kPixels = 5 * 4;
  std::vector<float> render(3 * kPixels);
  std::vector<std::uint8_t> color(3 * kPixels), valid(kPixels, 1);
  for (float& value : render) value = static_cast<float>(random.uniform(next++));
  for (std::uint8_t& value : color) value = static_cast<std::uint8_t>(255 * random.uniform(next++));
  valid[3] = valid[11] = 0;
  const TruthImage truth{5, 4, color, valid};
  const std::vector<float> exposure{0.2f, -0.1f};
  const auto objective = [&](const std::vector<float>& image, double log_gain, double offset) {
    double sum = 0;
    for (std::size_t k = 0; k < image.size(); ++k) {
      if (valid[k % kPixels] == 0) continue;
      sum += std::abs(std::exp(log_gain) * static_cast<double>(image[k]) + offset - color[k] / 255.0);
    }
    return 0.8 * sum / (3 * (kPixels - 2));
  };
  Threads threads(2);
  std::vector<float> gradient(render.size(), 1), exposure_gradient{1, 2};
  std::vector<double> workspace(4);
  add_exposed_l1(render, truth, exposure, 0.8f, gradient, exposure_gradient, workspace, threads);
  EXPECT_NEAR(workspace[0], objective(render, 0.2, -0.1), 1e-6);
  EXPECT_NEAR(exposure_gradient[0] - 1,
              (objective(render, 0.2 + 1e-6, -0.1) - objective(render, 0.2 - 1e-6, -0.1)) / 2e-6, 1e-5);
  EXPECT_NEAR(exposure_gradient[1] - 2,
              (objective(render, 0.2, -0.1 + 1e-6) - objective(render, 0.2, -0.1 - 1e-6)) / 2e-6, 1e-5);
  const double share = 0.8 / (3 * (kPixels - 2));
  for (std::size_t k = 0; k < render.size(); ++k) {
    const double difference = std::exp(0.2) * static_cast<double>(render[k]) - 0.1 - color[k] / 255.0;
    const double expected = valid[k % kPixels] == 0 ? 0 : (difference > 0 ? 1 : -1) * share * std::exp(0.2);
    EXPECT_NEAR(gradient[k] - 1, expected, 1e-6) << k;
  }
  std::vector<float> exposed(render.size());
  expose(render, exposure, exposed, threads);
  EXPECT_NEAR(exposed[7], std::exp(0.2) * static_cast<double>(render[7]) - 0.1, 1e-6);
}

}  // namespace
}  // namespace splatboost
