// SPDX-License-Identifier: Apache-2.0
#include "trainer/dataset/splat_ply.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>

#include "splatboost/errors.h"
#include "support/temporary_folder.h"

namespace splatboost::test {
namespace {

SplatCloud make_cloud(std::size_t n, int rest_rows) {
  SplatCloud cloud;
  cloud.sh_rest_rows = rest_rows;
  float next = 0.5f;
  const auto fill = [&](std::vector<float>& values, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) values.push_back(next += 0.37f);
  };
  fill(cloud.means, 3 * n);
  fill(cloud.sh_dc, 3 * n);
  fill(cloud.sh_rest, 3 * n * static_cast<std::size_t>(rest_rows));
  fill(cloud.logit_opacities, n);
  fill(cloud.log_scales, 3 * n);
  fill(cloud.rotations, 4 * n);
  return cloud;
}

void expect_equal(const SplatCloud& a, const SplatCloud& b) {
  EXPECT_EQ(a.sh_rest_rows, b.sh_rest_rows);
  EXPECT_EQ(a.means, b.means);
  EXPECT_EQ(a.sh_dc, b.sh_dc);
  EXPECT_EQ(a.sh_rest, b.sh_rest);
  EXPECT_EQ(a.logit_opacities, b.logit_opacities);
  EXPECT_EQ(a.log_scales, b.log_scales);
  EXPECT_EQ(a.rotations, b.rotations);
}

TEST(SplatPly, ComesBackBitByBit) {
  const TemporaryFolder folder;
  for (const int rest_rows : {0, 3, 8, 15}) {
    for (const std::size_t n : {std::size_t{0}, std::size_t{1}, std::size_t{5000}}) {
      const SplatCloud cloud = make_cloud(n, rest_rows);
      write_splat_ply(folder / "a.ply", cloud);
      expect_equal(read_splat_ply(folder / "a.ply"), cloud);
    }
  }
}

TEST(SplatPly, KeepsTheFiltersOfMipSplatting) {
  const TemporaryFolder folder;
  SplatCloud cloud = make_cloud(3, 15);
  cloud.filters = {0.25f, 0.5f, 0.125f};
  write_splat_ply(folder / "a.ply", cloud);
  EXPECT_EQ(read_splat_ply(folder / "a.ply").filters, cloud.filters);
  expect_equal(read_splat_ply(folder / "a.ply"), cloud);
  expect_contains(read_file(folder / "a.ply"), "property float rot_3\nproperty float filter_3D\nend_header");
  cloud.filters.pop_back();
  EXPECT_THROW(write_splat_ply(folder / "b.ply", cloud), ArgumentError);
}

TEST(SplatPly, HasTheLayoutOfTheField) {
  const TemporaryFolder folder;
  const SplatCloud cloud = make_cloud(2, 3);
  write_splat_ply(folder / "a.ply", cloud);
  const std::string file = read_file(folder / "a.ply");
  std::string expected = "ply\nformat binary_little_endian 1.0\nelement vertex 2\n";
  for (const char* name :
       {"x",        "y",        "z",        "nx",       "ny",       "nz",       "f_dc_0",   "f_dc_1",   "f_dc_2",
        "f_rest_0", "f_rest_1", "f_rest_2", "f_rest_3", "f_rest_4", "f_rest_5", "f_rest_6", "f_rest_7", "f_rest_8",
        "opacity",  "scale_0",  "scale_1",  "scale_2",  "rot_0",    "rot_1",    "rot_2",    "rot_3"}) {
    expected += std::string("property float ") + name + "\n";
  }
  expected += "end_header\n";
  ASSERT_EQ(file.substr(0, expected.size()), expected);
  ASSERT_EQ(file.size(), expected.size() + 2 * 26 * sizeof(float));
  std::vector<float> row(26);
  std::memcpy(row.data(), file.data() + expected.size() + 26 * sizeof(float), 26 * sizeof(float));  // the second splat
  EXPECT_EQ(row[3], 0.0f);
  EXPECT_EQ(row[5], 0.0f);
  // All coefficients of red, then of green, then of blue.
  for (std::size_t channel = 0; channel < 3; ++channel) {
    for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(row[9 + 3 * channel + k], cloud.sh_rest[(3 + k) * 3 + channel]);
  }
}

TEST(SplatPly, ReadsAsciiInAnyOrderWithExtras) {
  const TemporaryFolder folder;
  write_file(folder / "a.ply",
             "ply\r\nformat ascii 1.0\r\ncomment by hand\r\nelement extra 1\r\nproperty float q\r\nelement vertex 2\r\n"
             "property float rot_3\nproperty float rot_2\nproperty float rot_1\nproperty float rot_0\n"
             "property double opacity\nproperty float z\nproperty float y\nproperty float x\nproperty uchar label\n"
             "property float scale_2\nproperty float scale_1\nproperty float scale_0\n"
             "property float f_dc_2\nproperty float f_dc_1\nproperty float f_dc_0\n"
             "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
             "99\n"
             "4 3 2 1 0.5 30 20 10 7 -3 -2 -1 0.3 0.2 0.1\n"
             "8 7 6 5 -0.5 3e1 2e1 1e1 7 -6 -5 -4 0.6 0.5 0.4\n"
             "3 0 1 1\n");
  const SplatCloud cloud = read_splat_ply(folder / "a.ply");
  EXPECT_EQ(cloud.sh_rest_rows, 0);
  EXPECT_EQ(cloud.means, (std::vector<float>{10, 20, 30, 10, 20, 30}));
  EXPECT_EQ(cloud.sh_dc, (std::vector<float>{0.1f, 0.2f, 0.3f, 0.4f, 0.5f, 0.6f}));
  EXPECT_EQ(cloud.logit_opacities, (std::vector<float>{0.5f, -0.5f}));
  EXPECT_EQ(cloud.log_scales, (std::vector<float>{-1, -2, -3, -4, -5, -6}));
  EXPECT_EQ(cloud.rotations, (std::vector<float>{1, 2, 3, 4, 5, 6, 7, 8}));
}

TEST(SplatPly, SkipsShortAsciiRowsBeforeTheVertices) {
  // In an ascii file a row of the skipped element takes fewer bytes than its values in a binary one.
  const TemporaryFolder folder;
  std::string file =
      "ply\nformat ascii 1.0\nelement extra 500\nproperty double a\nproperty double b\n"
      "element vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
  for (int i = 0; i < 500; ++i) file += "0 1\n";
  write_file(folder / "a.ply", file + "4 5 6\n");
  EXPECT_EQ(read_point_ply(folder / "a.ply").positions, (std::vector<float>{4, 5, 6}));
}

TEST(SplatPly, EveryTruncationIsAnInputError) {
  const TemporaryFolder folder;
  write_splat_ply(folder / "whole.ply", make_cloud(3, 0));
  const std::string whole = read_file(folder / "whole.ply");
  for (std::size_t size = 0; size < whole.size(); size += size < 20 ? 1 : 13) {
    write_file(folder / "cut.ply", whole.substr(0, size));
    expect_contains(input_error_of([&] { read_splat_ply(folder / "cut.ply"); }), "cut.ply: ");
  }
  write_file(folder / "cut.ply", whole.substr(0, whole.size() - 1));
  expect_contains(input_error_of([&] { read_splat_ply(folder / "cut.ply"); }), "cut short");
}

TEST(SplatPly, BrokenFilesAreNamedWithTheCause) {
  const TemporaryFolder folder;
  const std::string properties =
      "property float x\nproperty float y\nproperty float z\nproperty float f_dc_0\nproperty float f_dc_1\n"
      "property float f_dc_2\nproperty float opacity\nproperty float scale_0\nproperty float scale_1\n"
      "property float scale_2\nproperty float rot_0\nproperty float rot_1\nproperty float rot_2\n";
  const auto message = [&](const std::string& content) {
    write_file(folder / "bad.ply", content);
    const std::string text = input_error_of([&] { read_splat_ply(folder / "bad.ply"); });
    expect_contains(text, "bad.ply: ");
    return text;
  };
  const std::string row = "1 2 3 4 5 6 7 8 9 10 11 12 13";
  const std::string ascii = "ply\nformat ascii 1.0\nelement vertex 1\n";
  expect_contains(message("hello"), "not a .ply");
  expect_contains(message(ascii + properties + "end_header\n" + row + "\n"), "rot_3");
  const std::string all = properties + "property float rot_3\n";
  EXPECT_EQ((write_file(folder / "good.ply", ascii + all + "end_header\n" + row + " 14"),
             read_splat_ply(folder / "good.ply").size()),
            1u);
  expect_contains(message(ascii + all + "end_header\n" + row + " x\n"), "not a number");
  expect_contains(message(ascii + all + "end_header\n" + row + " nan\n"), "rot_3");
  expect_contains(message("ply\nformat binary_big_endian 1.0\nelement vertex 0\n" + all + "end_header\n"),
                  "binary_big_endian");
  expect_contains(message("ply\nformat ascii 1.0\nend_header\n"), "vertex");
  expect_contains(message(ascii + all + "property float f_rest_0\nend_header\n" + row + " 14 15\n"), "f_rest");
  // Must not try to allocate the number of rows that the header declares.
  expect_contains(
      message("ply\nformat binary_little_endian 1.0\nelement vertex 99999999999999\n" + all + "end_header\n"),
      "cut short");
  // Must not try to skip the number of lines that the header declares, with or without properties.
  for (const char* property : {"", "property double q\n"}) {
    expect_contains(message("ply\nformat ascii 1.0\nelement extra 99999999999999\n" + std::string(property) +
                            "element vertex 1\n" + all + "end_header\n" + row + " 14\n"),
                    "cut short");
  }
  expect_contains(input_error_of([&] { read_splat_ply(folder / "none.ply"); }), "none.ply: the file does not exist");
  const std::string two = ascii + all + "end_header\n" + row + " 14\n" + row + " 14\n";
  expect_contains(message(two), "holds more data than the 1 vertices that its header promises");
}

// With a count that is too small, the rest was dropped, and the results of another model were written.
TEST(SplatPly, ACountThatIsTooSmallIsDamage) {
  const TemporaryFolder folder;
  write_splat_ply(folder / "model.ply", make_cloud(31, 0));
  std::string whole = read_file(folder / "model.ply");
  write_file(folder / "model.ply", whole + "\n");  // less than a vertex may follow
  EXPECT_EQ(read_splat_ply(folder / "model.ply").size(), 31u);
  whole.replace(whole.find("vertex 31"), 9, "vertex 30");
  write_file(folder / "model.ply", whole);
  expect_contains(input_error_of([&] { read_splat_ply(folder / "model.ply"); }),
                  "model.ply: holds more data than the 30 vertices");
}

TEST(SplatPly, AModelIsNoOutputForOtherFiles) {
  const TemporaryFolder folder;
  write_splat_ply(folder / "model.ply", make_cloud(2, 0));
  expect_contains(input_error_of([&] { require_no_model(folder / "model.ply"); }),
                  "model.ply: holds a model, which would be replaced; name another file");
  write_file(folder / "empty.ply", "");
  write_float_ply(folder / "points.ply", {{"x", "y", "z"}, {1, 2, 3}});
  for (const char* name : {"empty.ply", "points.ply", "none.ply"}) require_no_model(folder / name);
}

TEST(SplatPly, RefusesArraysThatDoNotMatch) {
  const TemporaryFolder folder;
  SplatCloud cloud = make_cloud(2, 3);
  cloud.means.pop_back();
  EXPECT_THROW(write_splat_ply(folder / "a.ply", cloud), ArgumentError);
  EXPECT_EQ(files_in(folder.path()), 0u);
}

TEST(SplatPly, WritesNoNumberThatIsNotFinite) {
  const TemporaryFolder folder;
  write_splat_ply(folder / "a.ply", make_cloud(3, 3));
  const std::string before = read_file(folder / "a.ply");
  for (const float value : {std::nanf(""), INFINITY, -INFINITY}) {
    SplatCloud cloud = make_cloud(3, 3);
    cloud.log_scales[7] = value;
    try {
      write_splat_ply(folder / "a.ply", cloud);
      ADD_FAILURE() << value;
    } catch (const std::runtime_error& error) {
      expect_contains(error.what(), "a.ply: not written: row 2 holds a number that is not finite");
    }
  }
  const FloatTable table{{"x", "y"}, {1, 2, 3, std::nanf("")}};
  EXPECT_THROW(write_float_ply(folder / "b.ply", table), std::runtime_error);
  EXPECT_EQ(read_file(folder / "a.ply"), before);
  EXPECT_EQ(files_in(folder.path()), 1u);
}

/// As hosts derived from 3DGS read it: they need normals, and divide colours by 255.
TEST(PointPly, WritesNormalsAndBytes) {
  const TemporaryFolder folder;
  const PointCloud cloud{{1, -2.5f, 3, 4, 5, 6e-3f}, {255, 128, 0, 1, 2, 3}};
  write_point_ply(folder / "p.ply", cloud);
  const std::string file = read_file(folder / "p.ply");
  const std::string header =
      "ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
      "property float z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty uchar red\n"
      "property uchar green\nproperty uchar blue\nend_header\n";
  EXPECT_EQ(file.substr(0, header.size()), header);
  EXPECT_EQ(file.size(), header.size() + 2 * (6 * 4 + 3));
  const PointCloud read = read_point_ply(folder / "p.ply");
  EXPECT_EQ(read.positions, cloud.positions);
  EXPECT_EQ(read.colors, cloud.colors);
  EXPECT_THROW(write_point_ply(folder / "q.ply", {{1, 2, std::nanf("")}, {1, 2, 3}}), std::runtime_error);
  EXPECT_EQ(files_in(folder.path()), 1u);
}

TEST(PointPly, ReadsPositionsAndColours) {
  const TemporaryFolder folder;
  write_file(
      folder / "p.ply",
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1 2 3 255 128 0\n4 5 6 1 2 3\n");
  PointCloud points = read_point_ply(folder / "p.ply");
  EXPECT_EQ(points.positions, (std::vector<float>{1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(points.colors, (std::vector<std::uint8_t>{255, 128, 0, 1, 2, 3}));
  write_file(folder / "p.ply",
             "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float "
             "z\nend_header\n1 2 3\n");
  points = read_point_ply(folder / "p.ply");
  EXPECT_EQ(points.colors, (std::vector<std::uint8_t>{128, 128, 128}));
}

TEST(PointPly, ColoursMayBeOfOtherTypes) {
  const TemporaryFolder folder;
  const auto colours = [&](const std::string& type, const std::string& values) {
    std::string header = "ply\nformat ascii 1.0\nelement vertex 1\n";
    for (const char* name : {"x", "y", "z"}) header += std::string("property float ") + name + "\n";
    for (const char* name : {"red", "green", "blue"}) header += "property " + type + " " + name + "\n";
    write_file(folder / "p.ply", header + "end_header\n1 2 3 " + values + "\n");
    return read_point_ply(folder / "p.ply").colors;
  };
  const std::vector<std::uint8_t> expected{50, 100, 150};
  EXPECT_EQ(colours("uchar", "50 100 150"), expected);
  EXPECT_EQ(colours("int", "50 100 150"), expected);
  EXPECT_EQ(colours("ushort", "12850 25700 38550"), expected);
  EXPECT_EQ(colours("float", "0.196 0.392 0.588"), expected);
  EXPECT_EQ(colours("double", "50 100 150"), expected);
  EXPECT_EQ(colours("float", "1 0 1"), (std::vector<std::uint8_t>{255, 0, 255}));
  EXPECT_EQ(colours("float", "-1 nan 300"), (std::vector<std::uint8_t>{0, 0, 255}));
}

}  // namespace
}  // namespace splatboost::test
