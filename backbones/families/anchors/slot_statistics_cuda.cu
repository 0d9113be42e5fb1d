// SPDX-License-Identifier: Apache-2.0
// A view contains each anchor and slot at most once, so no two threads add to the same element.
#include <cmath>

#include "device/device_view.h"
#include "device/launch.h"
#include "families/anchors/cuda_anchors.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    add_anchor_opacities_kernel(DeviceView<const std::uint32_t> anchors, std::size_t k,
                                DeviceView<const float> opacities, DeviceView<float> opacity_sums,
                                DeviceView<float> seen) {
  const std::size_t v = element_index();
  if (v >= anchors.size() || anchors[v] == kNothing) return;
  float sum = 0;
  for (std::size_t i = k * v; i < k * (v + 1); ++i) sum += opacities[i] > 0.0f ? opacities[i] : 0.0f;
  opacity_sums[anchors[v]] += sum;
  seen[anchors[v]] += 1.0f;
}

__global__ void __launch_bounds__(kBlockThreads)
    add_slot_gradients_kernel(DeviceView<const std::uint32_t> slots, DeviceView<const std::uint8_t> drawn,
                              DeviceView<const float> gradients, float to_ndc_x, float to_ndc_y,
                              DeviceView<float> gradient_sums, DeviceView<float> seen) {
  const std::size_t i = element_index();
  if (i >= slots.size() || slots[i] == kNothing || drawn[i] == 0) return;
  const float x = gradients[2 * i] * to_ndc_x, y = gradients[2 * i + 1] * to_ndc_y;
  gradient_sums[slots[i]] += std::sqrt(x * x + y * y);
  seen[slots[i]] += 1.0f;
}

__global__ void __launch_bounds__(kBlockThreads)
    add_slot_counts_kernel(DeviceView<const std::uint32_t> slots, DeviceView<const std::int32_t> view_counts,
                           DeviceView<std::int32_t> counts) {
  const std::size_t i = element_index();
  if (i < slots.size() && slots[i] != kNothing) counts[slots[i]] += view_counts[i];
}

}  // namespace

void add_anchor_opacities(std::span<const std::uint32_t> anchors, std::span<const float> opacities,
                          std::span<float> opacity_sums, std::span<float> seen, CudaStream& stream) {
  if (anchors.empty()) return;
  launch_each(stream, "add_anchor_opacities", add_anchor_opacities_kernel, anchors.size(), anchors,
              opacities.size() / anchors.size(), opacities, opacity_sums, seen);
}

void add_slot_gradients(std::span<const std::uint32_t> slots, std::span<const std::uint8_t> drawn,
                        std::span<const float> gradients, float to_ndc_x, float to_ndc_y,
                        std::span<float> gradient_sums, std::span<float> seen, CudaStream& stream) {
  launch_each(stream, "add_slot_gradients", add_slot_gradients_kernel, slots.size(), slots, drawn, gradients, to_ndc_x,
              to_ndc_y, gradient_sums, seen);
}

void add_slot_counts(std::span<const std::uint32_t> slots, std::span<const std::int32_t> view_counts,
                     std::span<std::int32_t> counts, CudaStream& stream) {
  launch_each(stream, "add_slot_counts", add_slot_counts_kernel, slots.size(), slots, view_counts, counts);
}

}  // namespace splatboost::cuda
