// SPDX-License-Identifier: Apache-2.0
// Distances between surfaces, against known values.
#include "trainer/mesh/surface_distance.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "splatboost/random.h"
#include "support/temporary_folder.h"
#include "trainer/mesh/tanks_and_temples.h"

namespace splatboost {
namespace {

/// A unit square at a height.
TriangleMesh square_at(float z) {
  TriangleMesh mesh;
  mesh.positions = {0, 0, z, 1, 0, z, 1, 1, z, 0, 1, z};
  mesh.triangles = {0, 1, 2, 0, 2, 3};
  return mesh;
}

TEST(SurfaceSamples, are_on_the_surface_and_leave_no_gap) {
  const std::vector<float> points = sample_surface(square_at(2), 0.05);
  EXPECT_GT(points.size() / 3, 380u);
  Threads threads(1);
  std::vector<float> grid;
  for (int i = 0; i <= 100; ++i) {
    for (int j = 0; j <= 100; ++j)
      grid.insert(grid.end(), {static_cast<float>(i) / 100, static_cast<float>(j) / 100, 2});
  }
  for (const double d : nearest_distances(grid, points, threads)) EXPECT_LT(d, 0.05);
  for (std::size_t i = 2; i < points.size(); i += 3) EXPECT_EQ(points[i], 2);
}

TEST(SurfaceSamples, refuse_a_spacing_that_would_fill_the_memory) {
  test::expect_contains(test::input_error_of([] { sample_surface(square_at(0), 2e-5); }),
                        "is too small: the surface would have");
}

TEST(VoxelMeans, are_one_point_per_voxel) {
  const std::vector<float> points{1.5f, 0, 0, 0.125f, 0.25f, 0.75f, -0.5f, 0, 0, 0.375f, 0.25f, 0.25f};
  EXPECT_EQ(voxel_means(points, 1), (std::vector<float>{-0.5f, 0, 0, 0.25f, 0.25f, 0.5f, 1.5f, 0, 0}));
  EXPECT_TRUE(voxel_means({}, 1).empty());
  EXPECT_EQ(voxel_means(points, 1e-30).size(), points.size()) << "voxel numbers beyond 64 bits";
}

TEST(ThinPoints, leaves_none_within_the_radius_of_another_and_none_without_one) {
  const std::vector<float> points = sample_surface(square_at(0), 0.01), thin = thin_points(points, 0.05, 1);
  EXPECT_LT(thin.size(), points.size() / 10);
  Threads threads(1);
  for (const double d : nearest_distances(points, thin, threads)) EXPECT_LE(d, 0.05);
  for (std::size_t i = 0; i < thin.size(); i += 3) {
    for (std::size_t j = i + 3; j < thin.size(); j += 3) {
      const float dx = thin[i] - thin[j], dy = thin[i + 1] - thin[j + 1];
      ASSERT_GE(std::sqrt(dx * dx + dy * dy), 0.05f);
    }
  }
  EXPECT_EQ(thin, thin_points(points, 0.05, 1));
}

TEST(SurfaceDistance, of_parallel_squares_is_their_distance) {
  Threads threads(2);
  const std::vector<float> low = sample_surface(square_at(0), 0.01), high = sample_surface(square_at(0.25f), 0.01);
  const SurfaceDistance d = compare_surfaces(high, low, 0.3, std::nullopt, threads);
  EXPECT_NEAR(d.accuracy, 0.25, 1e-4);
  EXPECT_NEAR(d.completeness, 0.25, 1e-4);
  EXPECT_NEAR(d.median_accuracy, 0.25, 1e-6);
  EXPECT_EQ(d.f1, 1);
  const SurfaceDistance strict = compare_surfaces(high, low, 0.2, std::nullopt, threads);
  EXPECT_EQ(strict.precision, 0);
  EXPECT_EQ(strict.f1, 0) << "not NaN";
}

TEST(SurfaceDistance, tells_what_is_wrong_from_what_is_missing) {
  // One of the two points is exact, the other is off by 3; only one of the four true points has a point within 1.
  Threads threads(1);
  const std::vector<float> found{0, 0, 0, 10, 0, 3}, truth{0, 0, 0, 10, 0, 0, 20, 0, 0, 30, 0, 0};
  const SurfaceDistance d = compare_surfaces(found, truth, 1, std::nullopt, threads);
  EXPECT_DOUBLE_EQ(d.precision, 0.5);
  EXPECT_DOUBLE_EQ(d.recall, 0.25);
  EXPECT_DOUBLE_EQ(d.f1, 2 * 0.5 * 0.25 / 0.75);
  EXPECT_NEAR(d.accuracy, 1.5, 1e-6);
  EXPECT_NEAR(d.completeness, (0 + 3 + std::sqrt(109.0) + std::sqrt(409.0)) / 4, 1e-5);
  const SurfaceDistance cut = compare_surfaces(found, truth, 1, 5, threads);
  EXPECT_NEAR(cut.completeness, 1.5, 1e-6) << "of pairs nearer than 5";
  EXPECT_NEAR(cut.chamfer, 1.5, 1e-6);
  EXPECT_EQ(cut.recall, d.recall) << "missing is missing";
}

TEST(CropVolume, is_a_polygon_between_two_heights) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "crop.json") << R"({"class_name": "SelectionPolygonVolume", "orthogonal_axis": "Y",
    "axis_min": -1, "axis_max": 2, "bounding_polygon": [[0, 0, 0], [4, 0, 0], [0, 0, 4]]})";
  const CropVolume volume = read_crop_volume(folder / "crop.json");
  // Inside; above; beyond the slanted edge; outside; nowhere.
  const std::vector<float> points{1, 1, 1, 1, 3, 1, 3, 1, 3, -1, 0, 1, 1, NAN, 1};
  EXPECT_EQ(cropped(points, volume), (std::vector<float>{1, 1, 1}));
  std::ofstream(folder / "bad.json") << R"({"orthogonal_axis": "W"})";
  test::expect_contains(test::input_error_of([&] { read_crop_volume(folder / "bad.json"); }), "orthogonal_axis");
  std::ofstream(folder / "none.json") << R"({"orthogonal_axis": "X"})";
  test::expect_contains(test::input_error_of([&] { read_crop_volume(folder / "none.json"); }), "axis_min");
}

TEST(Refinement, brings_a_mesh_that_is_nearly_aligned_to_the_truth) {
  // Three faces that meet in a corner, sampled at other points for the mesh, which is turned, moved and scaled.
  const RandomStream random(1, 0, RandomPurpose::synth);
  std::uint64_t next = 0;
  const auto faces = [&](std::size_t count) {
    std::vector<float> points;
    for (std::size_t i = 0; i < count; ++i) {
      const auto u = static_cast<float>(random.uniform(next++)), v = static_cast<float>(random.uniform(next++));
      const std::vector<float> on[3] = {{u, 0.8f * v, 0}, {u, 0, 0.6f * v}, {0, 0.8f * u, 0.6f * v}};
      points.insert(points.end(), on[i % 3].begin(), on[i % 3].end());
    }
    return points;
  };
  const std::vector<float> truth = faces(4000), aligned = faces(3000);
  const double c = 1.03 * std::cos(0.05), s = 1.03 * std::sin(0.05);
  std::vector<float> found = aligned;
  transform_points({c, -s, 0, 0.02, s, c, 0, -0.015, 0, 0, 1.03, 0.01, 0, 0, 0, 1}, found);
  const auto mean_error = [&] {
    double sum = 0;
    for (std::size_t k = 0; k < found.size(); k += 3) {
      const float dx = found[k] - aligned[k], dy = found[k + 1] - aligned[k + 1], dz = found[k + 2] - aligned[k + 2];
      sum += static_cast<double>(std::sqrt(dx * dx + dy * dy + dz * dz));
    }
    return sum / 3000;
  };
  ASSERT_GT(mean_error(), 0.02);
  Threads threads(2);
  CropVolume volume;
  volume.low = -1;
  volume.high = 2;
  volume.polygon = {{-1, -1, 0}, {2, -1, 0}, {2, 2, 0}, {-1, 2, 0}};
  transform_points(refined_alignment(found, truth, volume, 0.02, threads), found);
  EXPECT_LT(mean_error(), 0.005);
  transform_points({1, 0, 0, 50, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}, found);
  test::expect_contains(test::input_error_of([&] { refined_alignment(found, truth, volume, 0.02, threads); }),
                        "--align");
}

TEST(Thresholds, are_those_of_the_scenes) {
  EXPECT_EQ(tanks_and_temples_threshold("Ignatius"), 0.003);
  EXPECT_EQ(tanks_and_temples_threshold("Courthouse"), 0.025);
  EXPECT_EQ(tanks_and_temples_threshold("crop"), std::nullopt);
}

TEST(Transform, moves_points_as_its_rows_say) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "trans.txt") << "0 -2 0 1\n2 0 0 0\n0 0 2 -3\n0 0 0 1\n";
  std::vector<float> points{1, 2, 3};
  transform_points(read_transform(folder / "trans.txt"), points);
  EXPECT_EQ(points, (std::vector<float>{-3, 2, 3}));
  std::ofstream(folder / "short.txt") << "1 2 3";
  test::expect_contains(test::input_error_of([&] { read_transform(folder / "short.txt"); }), "16 numbers");
  std::ofstream(folder / "columns.txt") << "0 2 0 0\n-2 0 0 0\n0 0 2 0\n1 0 -3 1\n";
  test::expect_contains(test::input_error_of([&] { read_transform(folder / "columns.txt"); }), "last row");
  for (const double scale : {1e300, static_cast<double>(NAN)}) {
    test::expect_contains(test::input_error_of([&] {
                            transform_points({scale, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}, points);
                          }),
                          "not finite");
  }
}

}  // namespace
}  // namespace splatboost
