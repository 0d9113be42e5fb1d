// SPDX-License-Identifier: Apache-2.0
#include "trainer/mesh/mesh_picture.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include <glm/gtc/matrix_transform.hpp>

namespace splatboost {
namespace {

/// Camera at the origin that looks along z; a pixel is 0.1 wide at depth 1.
Camera looking_along_z() { return {20, 16, 10, 10, 10, 8}; }

/// A square around the optical axis at depth z, its sides along x and y, rotated about y by `turned` radians.
TriangleMesh square(float half, float z, double turned = 0) {
  TriangleMesh mesh;
  const auto c = static_cast<float>(std::cos(turned)), s = static_cast<float>(std::sin(turned));
  for (const auto& [x, y] : {std::pair{-half, -half}, {half, -half}, {half, half}, {-half, half}}) {
    mesh.positions.insert(mesh.positions.end(), {c * x, y, z + s * x});
  }
  mesh.triangles = {0, 1, 2, 0, 2, 3};
  return mesh;
}

/// Shade of a triangle of square(1, 2), 255 (0.1 + 0.9 cosine): the cosine at its centroid is 2 / sqrt(4 + 2/9).
constexpr int kFacing = 249;

TEST(MeshPicture, shows_a_square_where_it_projects) {
  const std::vector<std::uint8_t> picture = draw_mesh(square(1.0f, 2.0f), looking_along_z());  // 5 pixels to each side
  for (int y = 0; y < 16; ++y) {
    for (int x = 0; x < 20; ++x) {
      const std::uint8_t shade = picture[static_cast<std::size_t>(20 * y + x)];
      const bool inside = x >= 5 && x < 15 && y >= 3 && y < 13;
      EXPECT_EQ(shade > 0, inside) << x << " " << y;
    }
  }
  EXPECT_EQ(picture[20 * 8 + 10], kFacing);
}

TEST(MeshPicture, shades_by_the_angle_from_both_sides) {
  for (const double side : {1.0, -1.0}) {
    TriangleMesh mesh = square(1.0f, 4.0f, side * std::numbers::pi / 3);
    const auto shade = [&] { return draw_mesh(mesh, looking_along_z())[20 * 8 + 10]; };
    // cos 60° for a ray along the axis; the tolerance is for the triangle's centroid, which lies off the axis.
    EXPECT_NEAR(shade(), 255 * (0.1 + 0.9 * 0.5), 25);
    const std::uint8_t before = shade();
    std::swap(mesh.triangles[1], mesh.triangles[2]);
    std::swap(mesh.triangles[4], mesh.triangles[5]);
    EXPECT_EQ(shade(), before);
  }
}

TEST(MeshPicture, the_nearest_triangle_is_seen_in_any_order) {
  TriangleMesh mesh = square(0.5f, 1.0f, 1.0);  // near, dark
  const TriangleMesh far = square(2.0f, 3.0f);
  const std::uint8_t near_shade = draw_mesh(mesh, looking_along_z())[20 * 8 + 10];
  for (const bool first : {true, false}) {
    TriangleMesh both = first ? mesh : far;
    const TriangleMesh& other = first ? far : mesh;
    for (const std::uint32_t corner : other.triangles) both.triangles.push_back(corner + 4);
    both.positions.insert(both.positions.end(), other.positions.begin(), other.positions.end());
    const std::vector<std::uint8_t> picture = draw_mesh(both, looking_along_z());
    EXPECT_EQ(picture[20 * 8 + 10], near_shade);
    EXPECT_GT(picture[20 * 8 + 4], near_shade);  // the far square is visible beside it
  }
}

TEST(MeshPicture, leaves_out_what_is_behind_the_camera_and_takes_its_pose) {
  for (const std::uint8_t shade : draw_mesh(square(1.0f, -2.0f), looking_along_z())) EXPECT_EQ(shade, 0);
  TriangleMesh crossing = square(1.0f, 0.5f, 1.2);  // reaches behind the camera
  for (const std::uint8_t shade : draw_mesh(crossing, looking_along_z())) EXPECT_EQ(shade, 0);
  Camera turned = looking_along_z();
  turned.camera_from_world = glm::rotate(glm::mat4(1), std::numbers::pi_v<float>, glm::vec3(0, 1, 0));
  EXPECT_EQ(draw_mesh(square(1.0f, -2.0f), turned)[20 * 8 + 10], kFacing);
  EXPECT_EQ(draw_mesh({}, turned)[20 * 8 + 10], 0);
}

}  // namespace
}  // namespace splatboost
