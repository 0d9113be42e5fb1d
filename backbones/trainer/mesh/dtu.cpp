// SPDX-License-Identifier: Apache-2.0
#include "trainer/mesh/dtu.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "trainer/mesh/matlab_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr double kMarginBelow = 60, kMarginAbove = 120;

template <class Counts>
std::vector<float> those_that(std::span<const float> points, Counts&& counts) {
  std::vector<float> kept;
  for (std::size_t i = 0; i + 2 < points.size(); i += 3) {
    const std::array<double, 3> p{points[i], points[i + 1], points[i + 2]};
    if (counts(p)) kept.insert(kept.end(), &points[i], &points[i] + 3);
  }
  return kept;
}

bool finite(const std::vector<double>& values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
}

}  // namespace

DtuMask read_dtu_mask(const std::filesystem::path& path) {
  const std::string file = path.string();
  const MatlabArray<double> box = read_matlab_numbers(path, "BB"), step = read_matlab_numbers(path, "Res");
  require(box.shape == std::vector<std::size_t>{2, 3} && finite(box.values),
          file + ": BB must be a box of 2 x 3 numbers");
  require(step.values.size() == 1 && step.values[0] > 0 && finite(step.values),
          file + ": Res must be a length above 0");
  MatlabArray<std::uint8_t> flags = read_matlab_flags(path, "ObsMask");
  require(flags.shape.size() == 3, file + ": ObsMask must have three dimensions");
  DtuMask mask;
  for (std::size_t c = 0; c < 3; ++c) {
    mask.low[c] = box.values[2 * c];
    mask.high[c] = box.values[2 * c + 1];
    mask.size[c] = flags.shape[c];
    require(mask.low[c] < mask.high[c], file + ": BB must be a box of 2 x 3 numbers, the lower corner first");
  }
  mask.resolution = step.values[0];
  mask.observed = std::move(flags.values);
  return mask;
}

std::array<double, 4> read_dtu_plane(const std::filesystem::path& path) {
  const MatlabArray<double> plane = read_matlab_numbers(path, "P");
  require(plane.values.size() == 4 && finite(plane.values), path.string() + ": P must be a plane of 4 numbers");
  std::array<double, 4> out{};
  std::copy(plane.values.begin(), plane.values.end(), out.begin());
  return out;
}

std::vector<float> near_mask(std::span<const float> points, const DtuMask& mask) {
  return those_that(points, [&](const std::array<double, 3>& p) {
    for (std::size_t c = 0; c < 3; ++c) {
      if (!(p[c] >= mask.low[c] - kMarginBelow && p[c] < mask.high[c] + kMarginAbove)) return false;
    }
    return true;
  });
}

std::vector<float> observed(std::span<const float> points, const DtuMask& mask) {
  return those_that(points, [&](const std::array<double, 3>& p) {
    std::size_t at = 0, stride = 1;
    for (std::size_t c = 0; c < 3; ++c) {
      const double cell = std::nearbyint((p[c] - mask.low[c]) / mask.resolution);
      if (!(cell >= 0 && cell < static_cast<double>(mask.size[c]))) return false;
      at += stride * static_cast<std::size_t>(cell);
      stride *= mask.size[c];
    }
    return mask.observed[at] != 0;
  });
}

std::vector<float> above_plane(std::span<const float> points, const std::array<double, 4>& plane) {
  return those_that(points, [&](const std::array<double, 3>& p) {
    return plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2] + plane[3] > 0;
  });
}

}  // namespace splatboost
