// SPDX-License-Identifier: Apache-2.0
#include "families/anchors/slot_statistics.h"

#include <algorithm>
#include <cmath>

#include "families/anchors/cuda_anchors.h"
#include "splatboost/rows.h"

namespace splatboost {
namespace {
constexpr std::size_t kGrain = 4096;
}

void SlotStatistics::reset(std::size_t anchors) {
  opacity_sum_.assign_zeros(anchors);
  anchor_seen_.assign_zeros(anchors);
  gradient_sum_.assign_zeros(anchors * slots_);
  slot_seen_.assign_zeros(anchors * slots_);
}

void SlotStatistics::add_anchors(std::span<const std::uint32_t> anchors, std::span<const float> opacities) {
  if (device_.is_cuda()) {
    return cuda::add_anchor_opacities(anchors, opacities, opacity_sum_, anchor_seen_, device_.stream());
  }
  std::vector<float>&opacity_sum = opacity_sum_.host(), &seen = anchor_seen_.host();
  device_.threads().for_range(anchors.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t v = begin; v < end; ++v) {
      float sum = 0;
      for (std::size_t j = 0; j < slots_; ++j) sum += std::max(opacities[slots_ * v + j], 0.0f);
      opacity_sum[anchors[v]] += sum;
      seen[anchors[v]] += 1.0f;
    }
  });
}

void SlotStatistics::add_gaussians(std::span<const std::uint32_t> slots, std::span<const std::uint8_t> drawn,
                                   std::span<const float> gradients, int width, int height) {
  const float to_ndc_x = 0.5f * static_cast<float>(width), to_ndc_y = 0.5f * static_cast<float>(height);
  if (device_.is_cuda()) {
    return cuda::add_slot_gradients(slots, drawn, gradients, to_ndc_x, to_ndc_y, gradient_sum_, slot_seen_,
                                    device_.stream());
  }
  std::vector<float>&gradient_sum = gradient_sum_.host(), &seen = slot_seen_.host();
  device_.threads().for_range(slots.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if (drawn[i] == 0) continue;
      const float x = gradients[2 * i] * to_ndc_x, y = gradients[2 * i + 1] * to_ndc_y;
      gradient_sum[slots[i]] += std::sqrt(x * x + y * y);
      seen[slots[i]] += 1.0f;
    }
  });
}

void SlotStatistics::mean_gradients(std::vector<float>& means) const {
  std::vector<float> sum_copy, seen_copy;
  const std::span<const float> sum = gradient_sum_.on_host(sum_copy), seen = slot_seen_.on_host(seen_copy);
  means.resize(sum.size());
  for (std::size_t i = 0; i < means.size(); ++i) means[i] = sum[i] / std::max(seen[i], 1.0f);
}

void SlotStatistics::slots_seen_over(double views, std::vector<std::uint8_t>& mask) const {
  std::vector<float> copy;
  const std::span<const float> seen = slot_seen_.on_host(copy);
  mask.resize(seen.size());
  for (std::size_t i = 0; i < mask.size(); ++i) mask[i] = static_cast<double>(seen[i]) > views;
}

void SlotStatistics::faint_anchors(double views, double opacity, std::vector<std::uint8_t>& mask) const {
  std::vector<float> sum_copy, seen_copy;
  const std::span<const float> sum = opacity_sum_.on_host(sum_copy), seen = anchor_seen_.on_host(seen_copy);
  mask.resize(anchors());
  for (std::size_t i = 0; i < mask.size(); ++i) {
    const double times = static_cast<double>(seen[i]);
    mask[i] = times > views && static_cast<double>(sum[i]) < opacity * times;
  }
}

void SlotStatistics::restart_slots(std::span<const std::uint8_t> mask) {
  for (Array<float>* tensor : {&gradient_sum_, &slot_seen_}) {
    tensor->edit(0, [&](std::span<float> values) {
      for (std::size_t i = 0; i < mask.size(); ++i) {
        if (mask[i] != 0) values[i] = 0.0f;
      }
    });
  }
}

void SlotStatistics::restart_anchors_seen_over(double views) {
  opacity_sum_.edit(0, [&](std::span<float> sums) {
    anchor_seen_.edit(0, [&](std::span<float> seen) {
      for (std::size_t i = 0; i < seen.size(); ++i) {
        if (static_cast<double>(seen[i]) > views) sums[i] = seen[i] = 0.0f;
      }
    });
  });
}

void SlotStatistics::reserve(std::size_t anchors) {
  for (Array<float>* tensor : {&opacity_sum_, &anchor_seen_}) tensor->reserve(anchors);
  for (Array<float>* tensor : {&gradient_sum_, &slot_seen_}) tensor->reserve(slots_ * anchors);
}

void SlotStatistics::append(std::size_t anchors) {
  for (Array<float>* tensor : {&opacity_sum_, &anchor_seen_}) append_zero_rows(*tensor, 1, anchors);
  for (Array<float>* tensor : {&gradient_sum_, &slot_seen_}) append_zero_rows(*tensor, slots_, anchors);
}

void SlotStatistics::select(std::span<const std::uint32_t> anchors, Array<float>& workspace) {
  for (Array<float>* tensor : {&opacity_sum_, &anchor_seen_}) select_rows(*tensor, 1, anchors, workspace);
  for (Array<float>* tensor : {&gradient_sum_, &slot_seen_}) select_rows(*tensor, slots_, anchors, workspace);
}

void SlotStatistics::save(ArchiveWriter& archive) const {
  std::vector<float> copy;
  archive.put("statistics.opacity_sum", opacity_sum_.on_host(copy));
  archive.put("statistics.anchor_seen", anchor_seen_.on_host(copy));
  archive.put("statistics.gradient_sum", gradient_sum_.on_host(copy));
  archive.put("statistics.slot_seen", slot_seen_.on_host(copy));
}

bool SlotStatistics::load(const ArchiveReader& archive, std::size_t anchors) {
  opacity_sum_.assign(archive.floats("statistics.opacity_sum"));
  anchor_seen_.assign(archive.floats("statistics.anchor_seen"));
  gradient_sum_.assign(archive.floats("statistics.gradient_sum"));
  slot_seen_.assign(archive.floats("statistics.slot_seen"));
  return opacity_sum_.size() == anchors && anchor_seen_.size() == anchors && gradient_sum_.size() == anchors * slots_ &&
         slot_seen_.size() == anchors * slots_;
}

void add_slot_counts(std::span<const std::uint32_t> slots, std::span<const std::int32_t> view_counts,
                     std::span<std::int32_t> counts, Device device) {
  if (device.is_cuda()) return cuda::add_slot_counts(slots, view_counts, counts, device.stream());
  for (std::size_t i = 0; i < slots.size(); ++i) counts[slots[i]] += view_counts[i];
}

}  // namespace splatboost
