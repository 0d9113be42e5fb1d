// SPDX-License-Identifier: Apache-2.0
#include "trainer/mesh/triangle_mesh.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "support/temporary_folder.h"

namespace splatboost {
namespace {

/// A square of two triangles, and a separate triangle.
TriangleMesh square_and_triangle() {
  TriangleMesh mesh;
  mesh.positions = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, 9, 9, 9, 10, 9, 9, 9, 10, 9};
  mesh.triangles = {4, 5, 6, 0, 1, 2, 0, 2, 3};
  for (int k = 0; k < 21; ++k) mesh.colors.push_back(static_cast<std::uint8_t>(10 * k));
  return mesh;
}

TEST(TriangleMesh, comes_back_from_its_file) {
  const test::TemporaryFolder folder;
  const TriangleMesh mesh = square_and_triangle();
  write_mesh(folder / "mesh.ply", mesh);
  const TriangleMesh again = read_mesh(folder / "mesh.ply");
  EXPECT_EQ(again.positions, mesh.positions);
  EXPECT_EQ(again.triangles, mesh.triangles);
}

TEST(TriangleMesh, reads_text_points_and_polygons) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "text.ply")
      << "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty float "
         "nx\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar "
         "uint vertex_index\nend_header\n0 7 0 0\n1 7 0 0\n1 7 1 0\n0 7 1 0.5\n4 0 1 2 3\n";
  const TriangleMesh mesh = read_mesh(folder / "text.ply");
  EXPECT_EQ(mesh.positions, (std::vector<float>{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0.5f}));
  EXPECT_EQ(mesh.triangles, (std::vector<std::uint32_t>{0, 1, 2, 0, 2, 3}));
}

TEST(TriangleMesh, broken_files_are_told_in_one_line) {
  const test::TemporaryFolder folder;
  const std::string vertices = "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
  const auto error = [&](const std::string& text) {
    std::ofstream(folder / "broken.ply", std::ios::binary) << text;
    return test::input_error_of([&] { read_mesh(folder / "broken.ply"); });
  };
  test::expect_contains(error("obj\n"), "not a .ply file");
  test::expect_contains(error("ply\nformat ascii 1.0\n" + vertices), "has no end_header line");
  test::expect_contains(error("ply\nformat ascii 1.0\n" + vertices + "end_header\n1 2\n"), "ends early");
  test::expect_contains(error("ply\nformat binary_big_endian 1.0\n" + vertices + "end_header\n"), "is not supported");
  test::expect_contains(error("ply\nformat ascii 1.0\n" + vertices +
                              "element face 1\nproperty list uchar int vertex_indices\nend_header\n1 2 3\n3 0 0 1\n"),
                        "vertex that does not exist");
  test::expect_contains(error("ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n"),
                        "too small");
  test::expect_contains(error("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n"),
                        "no finite x, y or z");
  test::expect_contains(test::input_error_of([&] { read_mesh(folder / "none.ply"); }), "no such file");
  test::expect_contains(test::input_error_of([&] { write_mesh(folder / "mesh.obj", square_and_triangle()); }), ".glb");
}

TEST(TriangleMesh, leaves_its_largest_parts) {
  TriangleMesh mesh = square_and_triangle();
  EXPECT_EQ(keep_largest_parts(mesh, 2, 0), 2u);
  EXPECT_EQ(mesh.size(), 2u);
  EXPECT_EQ(mesh.vertices(), 4u);
  EXPECT_EQ(mesh.colors.size(), 12u);
  mesh = square_and_triangle();
  keep_largest_parts(mesh, 1, 1);
  EXPECT_EQ(mesh.size(), 2u);
  mesh = square_and_triangle();
  keep_largest_parts(mesh, 1, 0);
  EXPECT_EQ(mesh.size(), 3u);
  keep_largest_parts(mesh, 50, 0);
  EXPECT_EQ(mesh.size(), 0u);
}

/// [V,4] red, green, blue, alpha of a .glb's vertices.
std::vector<std::uint16_t> colors_of_glb(const std::string& bytes) {
  std::uint32_t length = 0;
  std::memcpy(&length, bytes.data() + 12, 4);
  const nlohmann::json view = nlohmann::json::parse(bytes.substr(20, length))["bufferViews"][2];
  std::vector<std::uint16_t> colors(view["byteLength"].get<std::size_t>() / 2);
  std::memcpy(colors.data(), bytes.data() + 28 + length + view["byteOffset"].get<std::size_t>(), 2 * colors.size());
  return colors;
}

TEST(TriangleMesh, is_a_binary_gltf) {
  const test::TemporaryFolder folder;
  const TriangleMesh mesh = square_and_triangle();
  write_mesh(folder / "mesh.glb", mesh);
  const std::string bytes = test::read_file(folder / "mesh.glb");
  const auto number = [&](std::size_t at) {
    std::uint32_t value = 0;
    std::memcpy(&value, bytes.data() + at, 4);
    return value;
  };
  EXPECT_EQ(bytes.substr(0, 4), "glTF");
  EXPECT_EQ(number(8), bytes.size());
  EXPECT_EQ(bytes.substr(16, 4), "JSON");
  const std::size_t length = number(12);
  EXPECT_EQ(length % 4, 0u);
  const nlohmann::json gltf = nlohmann::json::parse(bytes.substr(20, length));
  EXPECT_EQ(gltf["accessors"][0]["count"], 7);
  EXPECT_EQ(gltf["accessors"][0]["max"][0], 10);
  EXPECT_EQ(gltf["accessors"][1]["count"], 9);
  EXPECT_EQ(number(20 + length), gltf["buffers"][0]["byteLength"].get<std::uint32_t>());
  const std::size_t indices = 28 + length + gltf["bufferViews"][1]["byteOffset"].get<std::size_t>();
  EXPECT_EQ(number(indices + 4), 5u);
}

TEST(TriangleMesh, looks_as_the_pictures_in_a_gltf_viewer) {
  const test::TemporaryFolder folder;
  TriangleMesh mesh = square_and_triangle();
  mesh.colors[0] = 255;
  mesh.colors[1] = 128;
  mesh.colors[2] = 0;
  write_mesh(folder / "mesh.glb", mesh);
  const std::string bytes = test::read_file(folder / "mesh.glb");
  const std::vector<std::uint16_t> colors = colors_of_glb(bytes);
  ASSERT_EQ(colors.size(), 28u);
  EXPECT_EQ(colors[0], 65535);
  EXPECT_NEAR(colors[1], 0.2158605 * 65535, 1) << "vertex colours are linear";
  EXPECT_EQ(colors[2], 0);
  EXPECT_EQ(colors[3], 65535) << "opaque";
  std::uint32_t length = 0;
  std::memcpy(&length, bytes.data() + 12, 4);
  const nlohmann::json gltf = nlohmann::json::parse(bytes.substr(20, length));
  EXPECT_EQ(gltf["accessors"][2]["componentType"], 5123);
  EXPECT_EQ(gltf["extensionsUsed"][0], "KHR_materials_unlit");
  EXPECT_TRUE(gltf["materials"][0]["extensions"].contains("KHR_materials_unlit"));
  EXPECT_FALSE(gltf["materials"][0].contains("alphaMode"));
  EXPECT_EQ(gltf["meshes"][0]["primitives"][0]["material"], 0);
  mesh.colors.clear();
  write_mesh(folder / "plain.glb", mesh);
  EXPECT_EQ(test::read_file(folder / "plain.glb").find("materials"), std::string::npos);
}

TEST(TriangleMesh, what_is_translucent_is_so_in_its_files) {
  const test::TemporaryFolder folder;
  TriangleMesh mesh = square_and_triangle();
  for (int k = 0; k < 7; ++k) mesh.opacities.push_back(static_cast<std::uint8_t>(30 * k));
  write_mesh(folder / "mesh.ply", mesh);
  EXPECT_NE(test::read_file(folder / "mesh.ply").find("property uchar alpha"), std::string::npos);
  EXPECT_EQ(read_mesh(folder / "mesh.ply").positions, mesh.positions);
  write_mesh(folder / "mesh.glb", mesh);
  const std::string bytes = test::read_file(folder / "mesh.glb");
  std::uint32_t length = 0;
  std::memcpy(&length, bytes.data() + 12, 4);
  const nlohmann::json gltf = nlohmann::json::parse(bytes.substr(20, length));
  EXPECT_EQ(gltf["materials"][0]["alphaMode"], "BLEND");
  EXPECT_EQ(colors_of_glb(bytes)[4 * 6 + 3], 257 * 180);
  keep_largest_parts(mesh, 2, 0);
  EXPECT_EQ(mesh.opacities.size(), mesh.vertices());
}

}  // namespace
}  // namespace splatboost
