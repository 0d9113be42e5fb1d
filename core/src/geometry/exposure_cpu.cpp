// SPDX-License-Identifier: Apache-2.0
#include "splatboost/exposure.h"

#include <array>
#include <cmath>
#include <vector>

#include "geometry/cuda_ops.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {
constexpr std::size_t kGrain = 4096;
}

void expose(std::span<const float> render, std::span<const float> exposure, std::span<float> exposed, Device device) {
  SPLATBOOST_CHECK(render.size() == exposed.size() && exposure.size() == 2,
                   "images must have the same size, and the exposure must be two numbers");
  if (device.is_cuda()) return cuda::expose(render, exposure, exposed, device.stream());
  const float gain = std::exp(exposure[0]), offset = exposure[1];
  device.threads().for_range(render.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) exposed[k] = gain * render[k] + offset;
  });
}

void add_exposed_l1(std::span<const float> render, const TruthImage& truth, std::span<const float> exposure,
                    float weight, std::span<float> gradient, std::span<float> exposure_gradient,
                    std::span<double> workspace, Device device) {
  const std::size_t pixels = static_cast<std::size_t>(truth.width) * static_cast<std::size_t>(truth.height);
  SPLATBOOST_CHECK(render.size() == 3 * pixels && gradient.size() == render.size() && truth.color.size() == 3 * pixels,
                   "render, gradient and truth must be [3,H,W]");
  SPLATBOOST_CHECK(truth.valid.empty() || truth.valid.size() == pixels, "truth.valid must be empty or [H,W]");
  SPLATBOOST_CHECK(exposure.size() == 2 && exposure_gradient.size() == 2 && workspace.size() == 4,
                   "exposure and its gradient must be two numbers, the workspace four");
  if (device.is_cuda()) {
    return cuda::add_exposed_l1(render, truth, exposure, weight, gradient, exposure_gradient, workspace,
                                device.stream());
  }
  const float gain = std::exp(exposure[0]), offset = exposure[1];
  std::size_t counted = truth.valid.empty() ? pixels : 0;
  for (const std::uint8_t valid : truth.valid) counted += valid != 0 ? 1 : 0;
  workspace[0] = 0;
  if (counted == 0) return;
  const float share = weight / (3.0f * static_cast<float>(counted));
  // For each piece: Σ |difference|, Σ sign·render, Σ sign
  std::vector<std::array<double, 3>> sums((3 * pixels + kGrain - 1) / kGrain);
  device.threads().for_range(3 * pixels, kGrain, [&](std::size_t begin, std::size_t end) {
    std::array<double, 3>& sum = sums[begin / kGrain];
    for (std::size_t k = begin; k < end; ++k) {
      if (!truth.valid.empty() && truth.valid[k % pixels] == 0) continue;
      const float difference = gain * render[k] + offset - static_cast<float>(truth.color[k]) * (1.0f / 255.0f);
      const float sign = difference > 0 ? 1.0f : difference < 0 ? -1.0f : 0.0f;
      gradient[k] += share * sign * gain;
      sum[0] += static_cast<double>(std::abs(difference));
      sum[1] += static_cast<double>(sign * render[k]);
      sum[2] += static_cast<double>(sign);
    }
  });
  double total[3] = {0, 0, 0};
  for (const auto& sum : sums) {
    for (std::size_t c = 0; c < 3; ++c) total[c] += sum[c];
  }
  workspace[0] = static_cast<double>(share) * total[0];
  exposure_gradient[0] += share * gain * static_cast<float>(total[1]);
  exposure_gradient[1] += share * static_cast<float>(total[2]);
}

}  // namespace splatboost
