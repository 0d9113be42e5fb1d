// SPDX-License-Identifier: Apache-2.0
#include "splatboost/error_map.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "loss/cuda_ops.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

/// Keeps the min-max division defined (paper eq. 7); errors below it are equal for all purposes.
constexpr float kEpsilon = 1e-8f;
constexpr std::size_t kGrain = 1 << 14;

}  // namespace

std::size_t flag_errors(std::span<const float> render, const TruthImage& truth, float tau, std::span<float> error,
                        std::span<std::uint8_t> flagged, Device device) {
  SPLATBOOST_CHECK(truth.width > 0 && truth.height > 0, "truth.width and truth.height must be above 0");
  const std::size_t pixels = static_cast<std::size_t>(truth.width) * static_cast<std::size_t>(truth.height);
  SPLATBOOST_CHECK(render.size() == 3 * pixels && truth.color.size() == 3 * pixels, "render and truth must be [3,H,W]");
  SPLATBOOST_CHECK(truth.valid.empty() || truth.valid.size() == pixels, "truth.valid must be empty or [H,W]");
  SPLATBOOST_CHECK(error.size() == pixels && flagged.size() == pixels, "error and flagged must be [H,W]");
  SPLATBOOST_CHECK(tau >= 0.0f && tau <= 1.0f, "tau must lie in [0, 1]");
  if (device.is_cuda()) return cuda::flag_errors(render, truth, tau, 0.0f, error, flagged, device.stream()).flagged;
  const auto is_valid = [&](std::size_t p) { return truth.valid.empty() || truth.valid[p] != 0; };

  device.threads().for_range(pixels, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t p = begin; p < end; ++p) {
      float sum = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        sum += std::fabs(render[c * pixels + p] - static_cast<float>(truth.color[c * pixels + p]) / 255.0f);
      }
      error[p] = sum / 3.0f;
    }
  });
  float low = std::numeric_limits<float>::infinity(), high = -low;
  for (std::size_t p = 0; p < pixels; ++p) {
    if (!is_valid(p)) continue;
    low = std::min(low, error[p]);
    high = std::max(high, error[p]);
  }
  std::fill(flagged.begin(), flagged.end(), std::uint8_t{0});
  if (!(high > low)) return 0;  // constant error, or no valid pixel
  const float threshold = tau * (high - low + kEpsilon);
  std::size_t count = 0;
  for (std::size_t p = 0; p < pixels; ++p) {
    flagged[p] = is_valid(p) && error[p] - low > threshold;
    count += flagged[p];
  }
  return count;
}

}  // namespace splatboost
