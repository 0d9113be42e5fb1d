// SPDX-License-Identifier: Apache-2.0
#include "splatboost/error_map.h"

#include <algorithm>
#include <limits>

#include "loss/cuda_ops.h"
#include "loss/error_map_math.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

constexpr std::size_t kGrain = 1 << 14;

}  // namespace

ErrorCounts flag_errors(std::span<const float> render, const TruthImage& truth, float tau, std::span<float> error,
                        std::span<std::uint8_t> flagged, Device device) {
  SPLATBOOST_CHECK(truth.width > 0 && truth.height > 0, "truth.width and truth.height must be above 0");
  const std::size_t pixels = static_cast<std::size_t>(truth.width) * static_cast<std::size_t>(truth.height);
  SPLATBOOST_CHECK(render.size() == 3 * pixels && truth.color.size() == 3 * pixels, "render and truth must be [3,H,W]");
  SPLATBOOST_CHECK(truth.valid.empty() || truth.valid.size() == pixels, "truth.valid must be empty or [H,W]");
  SPLATBOOST_CHECK(error.size() == pixels && flagged.size() == pixels, "error and flagged must be [H,W]");
  SPLATBOOST_CHECK(tau >= 0.0f && tau <= 1.0f, "tau must lie in [0, 1]");
  if (device.is_cuda()) return cuda::flag_errors(render, truth, tau, error, flagged, device.stream());
  const auto is_valid = [&](std::size_t p) { return truth.valid.empty() || truth.valid[p] != 0; };

  device.threads().for_range(pixels, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t p = begin; p < end; ++p) error[p] = pixel_error(render, truth.color, p, pixels);
  });
  ErrorCounts counts;
  counts.valid = pixels - static_cast<std::size_t>(std::count(truth.valid.begin(), truth.valid.end(), std::uint8_t{0}));
  float low = std::numeric_limits<float>::infinity(), high = -low;
  for (std::size_t p = 0; p < pixels; ++p) {
    if (!is_valid(p)) continue;
    counts.covered += error[p] > kNoError;
    low = std::min(low, error[p]);
    high = std::max(high, error[p]);
  }
  const float threshold = flag_threshold(low, high, tau);
  for (std::size_t p = 0; p < pixels; ++p) {
    flagged[p] = is_valid(p) && error[p] - low > threshold;
    counts.flagged += flagged[p];
  }
  return counts;
}

}  // namespace splatboost
