// SPDX-License-Identifier: Apache-2.0
#include "trainer/mesh/dtu.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <string>

#include "support/temporary_folder.h"
#include "trainer/mesh/matlab_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

/// Writes MATLAB files of version 5, little endian, as documented: a header, then one matrix per array.
class MatlabWriter {
 public:
  explicit MatlabWriter(const std::filesystem::path& path) : out_(path, std::ios::binary) {
    std::string header(124, ' ');
    header.replace(0, 10, "MATLAB 5.0");
    out_ << header;
    put<std::uint16_t>(0x0100);
    out_ << "IM";
  }
  /// @param array_kind, number_kind class of the array and type of its numbers: 6 and 9 for doubles, 9 and 2 for bytes
  template <class Number>
  void array(const std::string& name, const std::vector<std::int32_t>& shape, const std::vector<Number>& values,
             std::uint32_t array_kind, std::uint32_t number_kind, std::uint32_t flags = 0) {
    const auto whole = [](std::size_t bytes) { return static_cast<std::uint32_t>((bytes + 7) / 8 * 8); };
    const std::size_t shape_bytes = 4 * shape.size(), value_bytes = sizeof(Number) * values.size();
    put<std::uint32_t>(14);
    put<std::uint32_t>(16 + 8 + whole(shape_bytes) + 8 + whole(name.size()) + 8 + whole(value_bytes));
    put<std::uint32_t>(6);
    put<std::uint32_t>(8);
    put<std::uint32_t>(array_kind | flags);
    put<std::uint32_t>(0);
    element(5, shape.data(), shape_bytes);
    element(1, name.data(), name.size());
    element(number_kind, values.data(), value_bytes);
  }
  void doubles(const std::string& name, const std::vector<std::int32_t>& shape, const std::vector<double>& values) {
    array(name, shape, values, 6, 9);
  }
  void bytes(const std::string& name, const std::vector<std::int32_t>& shape, const std::vector<std::uint8_t>& values) {
    array(name, shape, values, 9, 2);
  }

 private:
  template <class Number>
  void put(Number value) {
    out_.write(reinterpret_cast<const char*>(&value), sizeof value);
  }
  void element(std::uint32_t kind, const void* data, std::size_t size) {
    put<std::uint32_t>(kind);
    put<std::uint32_t>(static_cast<std::uint32_t>(size));
    out_.write(static_cast<const char*>(data), static_cast<std::streamsize>(size));
    for (; size % 8 != 0; ++size) out_.put('\0');
  }
  std::ofstream out_;
};

/// 4 × 3 × 2 points, 10 apart, from (-10, 0, 100); only (1, 2, 1) was observed.
DtuMask one_observed() {
  DtuMask mask;
  mask.low = {-10, 0, 100};
  mask.high = {20, 20, 110};
  mask.resolution = 10;
  mask.size = {4, 3, 2};
  mask.observed.assign(24, 0);
  mask.observed[1 + 4 * (2 + 3 * 1)] = 1;
  return mask;
}

using Points = std::vector<float>;

TEST(Dtu, a_point_counts_where_its_grid_point_was_observed) {
  // The observed grid point is at (0, 20, 110).
  const Points points = {0,   20, 110, 4.9f,   24.9f, 114.9f, 5.1f, 20,   110, 0,  14.9f,
                         110, 0,  20,  104.9f, 0,     20,     120,  -100, 20,  110};
  EXPECT_EQ(observed(points, one_observed()), (Points{0, 20, 110, 4.9f, 24.9f, 114.9f}));
}

TEST(Dtu, what_is_far_from_the_box_is_not_compared_with) {
  const Points points = {-70, 0, 100, -70.1f, 0, 100, 139.9f, 0, 100, 140, 0, 100, 0, -60.1f, 100, 0, 0, 230};
  EXPECT_EQ(near_mask(points, one_observed()), (Points{-70, 0, 100, 139.9f, 0, 100}));
}

TEST(Dtu, the_table_does_not_count) {
  const Points points = {0, 0, 5, 0, 0, 3, 0, 0, 4, 9, 9, 6};
  EXPECT_EQ(above_plane(points, {0, 0, 2, -8}), (Points{0, 0, 5, 9, 9, 6}));
}

TEST(Dtu, reads_its_files) {
  if (!has_matlab_files()) GTEST_SKIP() << "this build has no libmatio";
  const test::TemporaryFolder folder;
  const DtuMask wanted = one_observed();
  {
    MatlabWriter writer(folder / "ObsMask1_10.mat");
    writer.doubles("BB", {2, 3}, {-10, 20, 0, 20, 100, 110});
    writer.doubles("Res", {1, 1}, {10});
    // Any number but 0 means observed; class 9 with the logical flag.
    std::vector<std::uint8_t> flags = wanted.observed;
    for (std::uint8_t& flag : flags) flag = static_cast<std::uint8_t>(7 * flag);
    writer.array("ObsMask", {4, 3, 2}, flags, 9, 2, 0x200);
    MatlabWriter(folder / "Plane1.mat").doubles("P", {4, 1}, {0, 0, 2, -8});
  }
  const DtuMask mask = read_dtu_mask(folder / "ObsMask1_10.mat");
  EXPECT_EQ(mask.low, wanted.low);
  EXPECT_EQ(mask.high, wanted.high);
  EXPECT_EQ(mask.resolution, wanted.resolution);
  EXPECT_EQ(mask.size, wanted.size);
  EXPECT_EQ(mask.observed, wanted.observed);
  EXPECT_EQ(read_dtu_plane(folder / "Plane1.mat"), (std::array<double, 4>{0, 0, 2, -8}));
}

TEST(Dtu, refuses_files_that_hold_something_else) {
  const test::TemporaryFolder folder;
  const auto told = [](auto&& read) {
    try {
      read();
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  std::ofstream(folder / "text.mat") << "no arrays\n";
  const std::string text = told([&] { read_dtu_plane(folder / "text.mat"); });
  EXPECT_NE(text.find("text.mat"), std::string::npos);
  EXPECT_EQ(text.find('\n'), std::string::npos);
  if (!has_matlab_files()) {
    EXPECT_NE(text.find("libmatio-dev"), std::string::npos);
    return;
  }
  EXPECT_NE(told([&] { read_dtu_plane(folder / std::string(300, 'x')); }).find("no such file"), std::string::npos);
  MatlabWriter(folder / "Plane2.mat").doubles("P", {3, 1}, {0, 0, 2});
  EXPECT_NE(told([&] { read_dtu_plane(folder / "Plane2.mat"); }).find("plane of 4"), std::string::npos);
  MatlabWriter(folder / "other.mat").doubles("Q", {4, 1}, {0, 0, 2, 1});
  EXPECT_NE(told([&] { read_dtu_plane(folder / "other.mat"); }).find("P is missing"), std::string::npos);
  const auto mask = [&](const std::vector<double>& box, double step, const std::vector<std::int32_t>& shape) {
    {
      MatlabWriter writer(folder / "mask.mat");
      writer.doubles("BB", {2, 3}, box);
      writer.doubles("Res", {1, 1}, {step});
      writer.bytes("ObsMask", shape, std::vector<std::uint8_t>(8, 1));
    }
    return told([&] { read_dtu_mask(folder / "mask.mat"); });
  };
  EXPECT_EQ(mask({0, 1, 0, 1, 0, 1}, 1, {2, 2, 2}), "");
  EXPECT_NE(mask({1, 0, 0, 1, 0, 1}, 1, {2, 2, 2}).find("BB"), std::string::npos);
  EXPECT_NE(mask({0, 1, 0, 1, 0, 1}, 0, {2, 2, 2}).find("Res"), std::string::npos);
  EXPECT_NE(mask({0, 1, 0, 1, 0, 1}, 1, {2, 4}).find("three dimensions"), std::string::npos);
  // A truncated file.
  std::filesystem::resize_file(folder / "Plane2.mat", 150);
  EXPECT_NE(told([&] { read_dtu_plane(folder / "Plane2.mat"); }), "");
}

}  // namespace
}  // namespace splatboost
