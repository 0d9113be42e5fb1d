// SPDX-License-Identifier: Apache-2.0
#include "convex_splatting/convex_file.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "convex_splatting/convex_shapes.h"
#include "trainer/dataset/splat_ply.h"
#include "trainer/support/archive.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr std::size_t kRestRows = 15;
constexpr const char* kPly = "point_cloud.ply";
constexpr const char* kScreenFile = "convexes.bin";

std::vector<std::string> column_names() {
  std::vector<std::string> names{"x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2"};
  for (std::size_t k = 0; k < 3 * kRestRows; ++k) names.push_back("f_rest_" + std::to_string(k));
  for (const char* name : {"opacity", "mask", "smoothness", "sharpness"}) names.emplace_back(name);
  for (std::size_t k = 0; k < kConvexWidth; ++k) {
    names.push_back("point_" + std::to_string(k / 3) + "_" + "xyz"[k % 3]);
  }
  return names;
}

}  // namespace

std::uint64_t write_convexes(const std::filesystem::path& folder, const ConvexCloud& cloud) {
  FloatTable table{column_names(), {}};
  const std::vector<float> centres = convex_centres(cloud.points);
  table.values.reserve(cloud.size() * table.names.size());
  const auto append = [&](const std::vector<float>& values, std::size_t width, std::size_t i) {
    const auto first = values.begin() + static_cast<std::ptrdiff_t>(width * i);
    table.values.insert(table.values.end(), first, first + static_cast<std::ptrdiff_t>(width));
  };
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    append(centres, 3, i);
    append(cloud.sh_dc, 3, i);
    for (std::size_t k = 0; k < 3 * kRestRows; ++k) {  // channel by channel, as in 3DGS
      table.values.push_back(cloud.sh_rest[3 * (kRestRows * i + k % kRestRows) + k / kRestRows]);
    }
    append(cloud.logit_opacities, 1, i);
    append(cloud.logit_masks, 1, i);
    append(cloud.log_smoothness, 1, i);
    append(cloud.log_sharpness, 1, i);
    append(cloud.points, kConvexWidth, i);
  }
  write_float_ply(folder / kPly, table);
  ArchiveWriter archive;
  archive.put("focal_lengths", std::span<const float>(cloud.focal_lengths));
  write_second_file(folder / kPly, [&] { archive.write(folder / kScreenFile); });
  return std::filesystem::file_size(folder / kPly) + std::filesystem::file_size(folder / kScreenFile);
}

ConvexCloud read_convexes(const std::filesystem::path& folder) {
  const FloatTable table = read_float_ply(folder / kPly, column_names());
  const std::size_t n = table.rows(), width = table.names.size();
  ConvexCloud cloud;
  cloud.sh_rest.resize(3 * kRestRows * n);
  for (std::size_t i = 0; i < n; ++i) {
    const float* at = table.values.data() + width * i + 3;  // skips the centre, which is computed from the points
    const auto take = [&](std::vector<float>& values, std::size_t count) {
      values.insert(values.end(), at, at + count);
      at += count;
    };
    take(cloud.sh_dc, 3);
    for (std::size_t k = 0; k < 3 * kRestRows; ++k) {
      cloud.sh_rest[3 * (kRestRows * i + k % kRestRows) + k / kRestRows] = *at++;
    }
    take(cloud.logit_opacities, 1);
    take(cloud.logit_masks, 1);
    take(cloud.log_smoothness, 1);
    take(cloud.log_sharpness, 1);
    take(cloud.points, kConvexWidth);
  }
  require_second_file(folder / kScreenFile);
  const ArchiveReader archive(folder / kScreenFile);
  cloud.focal_lengths = archive.floats("focal_lengths");
  const auto usable = [](float focal) { return focal > 0 && std::isfinite(focal); };
  require(!cloud.focal_lengths.empty() && std::ranges::all_of(cloud.focal_lengths, usable),
          archive.path().string() + ": 'focal_lengths' must contain one or more finite numbers above 0");
  return cloud;
}

}  // namespace splatboost
