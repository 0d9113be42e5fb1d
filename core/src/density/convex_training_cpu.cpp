// SPDX-License-Identifier: Apache-2.0
#include "density/convex_training_math.h"
#include "density/cuda_ops.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {
constexpr std::size_t kGrain = 4096;
}

void mask_opacities(std::span<const float> opacities, std::span<const float> masks, std::span<float> drawn,
                    Device device) {
  SPLATBOOST_CHECK(masks.size() == opacities.size() && drawn.size() == opacities.size(),
                   "opacities, masks and drawn must have the same size");
  if (device.is_cuda()) return cuda::mask_opacities(opacities, masks, drawn, device.stream());
  device.threads().for_range(drawn.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) drawn[i] = masked_opacity(opacities[i], masks[i]);
  });
}

void mask_opacities_backward(std::span<const float> opacities, std::span<const float> masks,
                             std::span<const float> drawn, float mask_slope, std::span<float> opacity_gradients,
                             std::span<float> mask_gradients, Device device) {
  const std::size_t n = opacities.size();
  SPLATBOOST_CHECK(
      masks.size() == n && drawn.size() == n && opacity_gradients.size() == n && mask_gradients.size() == n,
      "opacities, masks and their gradients must have the same size");
  if (device.is_cuda()) {
    return cuda::mask_opacities_backward(opacities, masks, drawn, mask_slope, opacity_gradients, mask_gradients,
                                         device.stream());
  }
  device.threads().for_range(n, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      add_masked_gradients(opacities[i], masks[i], drawn[i], mask_slope, opacity_gradients[i], mask_gradients[i]);
    }
  });
}

void add_sharpness_gradients(std::span<const std::uint8_t> visible, std::span<const float> gradients,
                             std::span<const float> gradients_abs, const SharpnessSums& sums, Device device) {
  const std::size_t n = sums.gradients.size();
  SPLATBOOST_CHECK(sums.gradients_abs.size() == n && sums.views.size() == n, "the sums must have the same size");
  SPLATBOOST_CHECK(visible.size() == n && gradients.size() == n && (gradients_abs.empty() || gradients_abs.size() == n),
                   "the view must have the same number of convexes");
  if (device.is_cuda()) {
    return cuda::add_sharpness_gradients(visible, gradients, gradients_abs, sums, device.stream());
  }
  device.threads().for_range(n, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if (visible[i] == 0) continue;
      sums.gradients[i] += gradients[i];
      if (!gradients_abs.empty()) sums.gradients_abs[i] += gradients_abs[i];
      sums.views[i] += 1.0f;
    }
  });
}

}  // namespace splatboost
