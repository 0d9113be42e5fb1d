// SPDX-License-Identifier: Apache-2.0
#include "anchors/slot_statistics.h"

#include <algorithm>
#include <cmath>

#include "splatboost/rows.h"

namespace splatboost {
namespace {
constexpr std::size_t kGrain = 4096;
}

void SlotStatistics::reset(std::size_t anchors) {
  opacity_sum_.assign(anchors, 0.0f);
  anchor_seen_.assign(anchors, 0.0f);
  gradient_sum_.assign(anchors * slots_, 0.0f);
  slot_seen_.assign(anchors * slots_, 0.0f);
}

void SlotStatistics::add_anchors(std::span<const std::uint32_t> anchors, std::span<const float> opacities) {
  threads_.for_range(anchors.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t v = begin; v < end; ++v) {
      float sum = 0;
      for (std::size_t j = 0; j < slots_; ++j) sum += std::max(opacities[slots_ * v + j], 0.0f);
      opacity_sum_[anchors[v]] += sum;
      anchor_seen_[anchors[v]] += 1.0f;
    }
  });
}

void SlotStatistics::add_gaussians(std::span<const std::uint32_t> slots, std::span<const std::uint8_t> drawn,
                                   std::span<const float> gradients, int width, int height) {
  const float to_ndc_x = 0.5f * static_cast<float>(width), to_ndc_y = 0.5f * static_cast<float>(height);
  threads_.for_range(slots.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if (drawn[i] == 0) continue;
      const float x = gradients[2 * i] * to_ndc_x, y = gradients[2 * i + 1] * to_ndc_y;
      gradient_sum_[slots[i]] += std::sqrt(x * x + y * y);
      slot_seen_[slots[i]] += 1.0f;
    }
  });
}

void SlotStatistics::mean_gradients(std::vector<float>& means) const {
  means.resize(gradient_sum_.size());
  for (std::size_t i = 0; i < means.size(); ++i) means[i] = gradient_sum_[i] / std::max(slot_seen_[i], 1.0f);
}

void SlotStatistics::slots_seen_over(double views, std::vector<std::uint8_t>& mask) const {
  mask.resize(slot_seen_.size());
  for (std::size_t i = 0; i < mask.size(); ++i) mask[i] = static_cast<double>(slot_seen_[i]) > views;
}

void SlotStatistics::faint_anchors(double views, double opacity, std::vector<std::uint8_t>& mask) const {
  mask.resize(anchors());
  for (std::size_t i = 0; i < mask.size(); ++i) {
    const double seen = static_cast<double>(anchor_seen_[i]);
    mask[i] = seen > views && static_cast<double>(opacity_sum_[i]) < opacity * seen;
  }
}

void SlotStatistics::restart_slots(std::span<const std::uint8_t> mask) {
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if (mask[i] != 0) gradient_sum_[i] = slot_seen_[i] = 0.0f;
  }
}

void SlotStatistics::restart_anchors_seen_over(double views) {
  for (std::size_t i = 0; i < anchors(); ++i) {
    if (static_cast<double>(anchor_seen_[i]) > views) opacity_sum_[i] = anchor_seen_[i] = 0.0f;
  }
}

void SlotStatistics::append(std::size_t anchors) {
  for (std::vector<float>* tensor : {&opacity_sum_, &anchor_seen_}) append_zero_rows(*tensor, 1, anchors);
  for (std::vector<float>* tensor : {&gradient_sum_, &slot_seen_}) append_zero_rows(*tensor, slots_, anchors);
}

void SlotStatistics::remove(std::span<const std::uint8_t> removed_anchors) {
  for (std::vector<float>* tensor : {&opacity_sum_, &anchor_seen_}) remove_rows(*tensor, 1, removed_anchors);
  for (std::vector<float>* tensor : {&gradient_sum_, &slot_seen_}) remove_rows(*tensor, slots_, removed_anchors);
}

void SlotStatistics::save(ArchiveWriter& archive) const {
  archive.put("statistics.opacity_sum", std::span<const float>(opacity_sum_));
  archive.put("statistics.anchor_seen", std::span<const float>(anchor_seen_));
  archive.put("statistics.gradient_sum", std::span<const float>(gradient_sum_));
  archive.put("statistics.slot_seen", std::span<const float>(slot_seen_));
}

bool SlotStatistics::load(const ArchiveReader& archive, std::size_t anchors) {
  opacity_sum_ = archive.floats("statistics.opacity_sum");
  anchor_seen_ = archive.floats("statistics.anchor_seen");
  gradient_sum_ = archive.floats("statistics.gradient_sum");
  slot_seen_ = archive.floats("statistics.slot_seen");
  return opacity_sum_.size() == anchors && anchor_seen_.size() == anchors && gradient_sum_.size() == anchors * slots_ &&
         slot_seen_.size() == anchors * slots_;
}

}  // namespace splatboost
