// SPDX-License-Identifier: Apache-2.0
// Depth images of a sphere and of a plane, and the meshes extracted from them.
#include "trainer/mesh/tsdf_volume.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include <glm/geometric.hpp>

#include "support/looking_camera.h"
#include "support/temporary_folder.h"

namespace splatboost {
namespace {

struct DepthImage {
  std::vector<float> depth, color;
};

/// A unit sphere at the origin; red where x > 0, else blue.
DepthImage sphere_seen_by(const Camera& camera) {
  const glm::mat4 world_from_camera = glm::inverse(camera.camera_from_world);
  const glm::vec3 centre(world_from_camera[3]);
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  DepthImage image{std::vector<float>(pixels, 0.0f), std::vector<float>(3 * pixels, 0.0f)};
  for (std::size_t p = 0; p < pixels; ++p) {
    const auto x = static_cast<float>(p % static_cast<std::size_t>(camera.width)) + 0.5f;
    const auto y = static_cast<float>(p / static_cast<std::size_t>(camera.width)) + 0.5f;
    const glm::vec3 ray =
        glm::mat3(world_from_camera) * glm::vec3((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1);
    const float a = glm::dot(ray, ray), b = glm::dot(ray, centre), c = glm::dot(centre, centre) - 1;
    const float root = b * b - a * c;
    if (root < 0) continue;
    image.depth[p] = (-b - std::sqrt(root)) / a;
    const bool red = centre.x + image.depth[p] * ray.x > 0;
    image.color[(red ? 0 : 2) * pixels + p] = 1;
  }
  return image;
}

class Tsdf : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!has_tsdf_volumes()) GTEST_SKIP() << "this build has no OpenVDB";
  }
  TriangleMesh sphere(int views, int least_views, float voxel = 0.04f) {
    TsdfVolume volume({voxel, 4 * voxel, std::uint64_t{1} << 30});
    for (int v = 0; v < views; ++v) {
      const float angle = 6.2831853f * static_cast<float>(v) / static_cast<float>(views);
      const glm::vec3 eye = 3.0f * glm::vec3(std::cos(angle), 0.4f * (v % 2 == 0 ? 1.0f : -1.0f), std::sin(angle));
      const Camera camera = testing::camera_looking_at_origin(eye, 96, 96);
      const DepthImage image = sphere_seen_by(camera);
      volume.integrate(camera, image.depth, image.color, threads_);
    }
    return volume.mesh(least_views, threads_);
  }
  Threads threads_{2};
};

TEST_F(Tsdf, finds_a_sphere_with_its_colours_faces_outwards) {
  const TriangleMesh mesh = sphere(8, 1);
  ASSERT_GT(mesh.size(), 1000u);
  double sum = 0;
  for (std::size_t i = 0; i < mesh.vertices(); ++i) {
    const glm::vec3 point(mesh.positions[3 * i], mesh.positions[3 * i + 1], mesh.positions[3 * i + 2]);
    sum += std::abs(glm::length(point) - 1);
    EXPECT_LT(std::abs(glm::length(point) - 1), 0.08f) << "no back of the truncated band";
    if (std::abs(point.x) > 0.1f) {
      EXPECT_EQ(mesh.colors[3 * i] > 128, point.x > 0);
      EXPECT_EQ(mesh.colors[3 * i + 2] > 128, point.x < 0);
    }
  }
  EXPECT_LT(sum / static_cast<double>(mesh.vertices()), 0.01);
  std::size_t outwards = 0;
  double area = 0;
  for (std::size_t t = 0; t < mesh.size(); ++t) {
    glm::vec3 corners[3];
    for (std::size_t k = 0; k < 3; ++k) {
      const float* at = &mesh.positions[3 * mesh.triangles[3 * t + k]];
      corners[k] = {at[0], at[1], at[2]};
    }
    const glm::vec3 normal = glm::cross(corners[1] - corners[0], corners[2] - corners[0]);
    outwards += glm::dot(normal, corners[0]) > 0 ? 1 : 0;
    area += 0.5 * static_cast<double>(glm::length(normal));
  }
  EXPECT_GT(outwards, mesh.size() * 98 / 100);
  EXPECT_GT(area, 0.75 * 4 * 3.14159) << "but for the poles";
  EXPECT_LT(area, 1.05 * 4 * 3.14159);
}

TEST_F(Tsdf, leaves_out_what_few_views_saw) {
  const TriangleMesh all = sphere(8, 1), often = sphere(8, 3);
  EXPECT_LT(often.size(), all.size() * 9 / 10);
  EXPECT_GT(often.size(), 100u);
}

TEST_F(Tsdf, gives_the_same_mesh_again) {
  const TriangleMesh first = sphere(4, 1), second = sphere(4, 1);
  EXPECT_EQ(first.positions, second.positions);
  EXPECT_EQ(first.triangles, second.triangles);
}

TEST_F(Tsdf, says_when_it_would_take_too_much_memory) {
  TsdfVolume volume({0.01f, 0.04f, 1 << 20});
  const Camera camera = testing::camera_looking_at_origin({3, 0, 0}, 96, 96);
  const DepthImage image = sphere_seen_by(camera);
  test::expect_contains(test::input_error_of([&] { volume.integrate(camera, image.depth, image.color, threads_); }),
                        "--voxel-size");
}

}  // namespace
}  // namespace splatboost
