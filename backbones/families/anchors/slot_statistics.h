// SPDX-License-Identifier: Apache-2.0
/// @file What growth and pruning of anchors are decided on, gathered view by view.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "splatboost/array.h"
#include "splatboost/device.h"
#include "trainer/support/archive.h"

namespace splatboost {

/// Sums over views. A slot is anchor·k + offset. Slots and anchors are judged once they have been seen often enough,
/// and only those that were judged start again: the others keep gathering from event to event.
///
/// Sums lie in memory of the device, and so does what a view adds, which costs no wait; what is decided on them is of
/// the host. Places of lists that are kNothing (anchor_view.h) are passed over.
class SlotStatistics {
 public:
  /// @param slots k, slots of an anchor
  SlotStatistics(std::size_t slots, Device device) : slots_(slots), device_(device) {}

  void reset(std::size_t anchors);

  /// One view. @param anchors [V] in view @param opacities [V,k] of their slots, below 0 where nothing was drawn
  void add_anchors(std::span<const std::uint32_t> anchors, std::span<const float> opacities);
  /// One view. @param slots [M] of its Gaussians, each once @param drawn [M] @param gradients [M,2] of the mean on
  /// screen, pixels
  void add_gaussians(std::span<const std::uint32_t> slots, std::span<const std::uint8_t> drawn,
                     std::span<const float> gradients, int width, int height);

  /// [N·k] mean norm of the screen gradient in NDC units, 0 where never drawn.
  void mean_gradients(std::vector<float>& means) const;
  /// [N·k] non-zero where drawn in more than `views` views.
  void slots_seen_over(double views, std::vector<std::uint8_t>& mask) const;
  /// [N] non-zero where in more than `views` views with a mean opacity sum below `opacity`.
  void faint_anchors(double views, double opacity, std::vector<std::uint8_t>& mask) const;

  void restart_slots(std::span<const std::uint8_t> mask);
  void restart_anchors_seen_over(double views);
  /// Makes room for so many anchors in all: where memory is short nothing has changed.
  void reserve(std::size_t anchors);
  void append(std::size_t anchors);
  /// Leaves the anchors that the list names, in its order. @param workspace as of select_rows(), for k floats an anchor
  void select(std::span<const std::uint32_t> anchors, Array<float>& workspace);

  std::size_t anchors() const { return anchor_seen_.size(); }
  void save(ArchiveWriter& archive) const;
  /// @return whether what was read has `anchors` rows
  bool load(const ArchiveReader& archive, std::size_t anchors);

 private:
  std::size_t slots_;
  Device device_;
  Array<float> opacity_sum_{device_}, anchor_seen_{device_};  ///< [N]
  Array<float> gradient_sum_{device_}, slot_seen_{device_};   ///< [N,k]
};

/// counts[slots[i]] += view_counts[i]: from the Gaussians of a view to the slots that they are of.
void add_slot_counts(std::span<const std::uint32_t> slots, std::span<const std::int32_t> view_counts,
                     std::span<std::int32_t> counts, Device device);

}  // namespace splatboost
