// SPDX-License-Identifier: Apache-2.0
/// @file What growth and pruning of anchors are decided on, gathered view by view.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/archive.h"
#include "splatboost/threads.h"

namespace splatboost {

/// Sums over views. A slot is anchor·k + offset. Slots and anchors are judged once they have been seen often enough,
/// and only those that were judged start again: the others keep gathering from event to event.
class SlotStatistics {
 public:
  /// @param slots k, slots of an anchor
  SlotStatistics(std::size_t slots, Threads& threads) : slots_(slots), threads_(threads) {}

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
  void append(std::size_t anchors);
  void remove(std::span<const std::uint8_t> removed_anchors);

  std::size_t anchors() const { return anchor_seen_.size(); }
  void save(ArchiveWriter& archive) const;
  /// @return whether what was read has `anchors` rows
  bool load(const ArchiveReader& archive, std::size_t anchors);

 private:
  std::size_t slots_;
  Threads& threads_;
  std::vector<float> opacity_sum_, anchor_seen_;  ///< [N]
  std::vector<float> gradient_sum_, slot_seen_;   ///< [N·k]
};

}  // namespace splatboost
