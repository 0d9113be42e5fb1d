// SPDX-License-Identifier: Apache-2.0
/// @file Statistics for growth and pruning of anchors, accumulated over views.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "splatboost/array.h"
#include "splatboost/device.h"
#include "trainer/support/archive.h"

namespace splatboost {

/// Sums over views. A slot is anchor·k + offset. Slots and anchors are judged once they have been seen often enough;
/// growth resets only those judged, the others keep accumulating.
///
/// Sums and the inputs of a view are in device memory, so that adding a view does not synchronise; results for growth
/// and pruning are in host memory. List entries that are kNothing (anchor_view.h) are skipped.
class SlotStatistics {
 public:
  /// @param slots k, slots per anchor
  SlotStatistics(std::size_t slots, Device device) : slots_(slots), device_(device) {}

  void reset(std::size_t anchors);

  /// Adds one view. @param anchors [V] in view @param opacities [V,k] of their slots, negative where not drawn
  void add_anchors(std::span<const std::uint32_t> anchors, std::span<const float> opacities);
  /// Adds one view. @param slots [M] of its Gaussians, without duplicates @param drawn [M] zero: not drawn
  /// @param gradients [M,2] with respect to the screen means, in pixels
  void add_gaussians(std::span<const std::uint32_t> slots, std::span<const std::uint8_t> drawn,
                     std::span<const float> gradients, int width, int height);

  /// [N·k] mean norm of the screen gradient in NDC units, 0 where never drawn.
  void mean_gradients(std::vector<float>& means) const;
  /// [N·k] non-zero where drawn in more than `views` views.
  void slots_seen_over(double views, std::vector<std::uint8_t>& mask) const;
  /// [N] non-zero for anchors in more than `views` views whose mean opacity sum is below `opacity`.
  void faint_anchors(double views, double opacity, std::vector<std::uint8_t>& mask) const;

  void restart_slots(std::span<const std::uint8_t> mask);
  void restart_anchors_seen_over(double views);
  /// Reserves memory for this total number of anchors; if memory runs out, nothing has changed.
  void reserve(std::size_t anchors);
  void append(std::size_t anchors);
  /// Keeps the listed anchors, in the order of the list. @param workspace see select_rows(); k floats per anchor
  void select(std::span<const std::uint32_t> anchors, Array<float>& workspace);

  std::size_t anchors() const { return anchor_seen_.size(); }
  void save(ArchiveWriter& archive) const;
  /// @return whether the loaded statistics have `anchors` rows
  bool load(const ArchiveReader& archive, std::size_t anchors);

 private:
  std::size_t slots_;
  Device device_;
  Array<float> opacity_sum_{device_}, anchor_seen_{device_};  ///< [N]
  Array<float> gradient_sum_{device_}, slot_seen_{device_};   ///< [N,k]
};

/// counts[slots[i]] += view_counts[i]: adds counts of a view's Gaussians to their slots.
void add_slot_counts(std::span<const std::uint32_t> slots, std::span<const std::int32_t> view_counts,
                     std::span<std::int32_t> counts, Device device);

}  // namespace splatboost
