// SPDX-License-Identifier: Apache-2.0
/// @file Selection of the keyframe and image size that an iteration of the mapper trains on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace splatboost {

/// The schedule of Photo-SLAM: cycles through the keyframes in random order; each has a number of uses left, and those
/// without are skipped. When no keyframe has uses left, all get one. The first uses of a keyframe are at the levels of
/// its pyramid, the smallest first.
class KeyframeSchedule {
 public:
  struct Choice {
    std::size_t keyframe = 0;
    int level = 0;  ///< halvings of its image; 0: full size
  };

  /// @param uses number of uses of a new keyframe @param levels of its pyramid, without full size
  /// @param level_uses number of uses of each level
  KeyframeSchedule(int uses, int levels, int level_uses, std::uint64_t seed)
      : uses_(uses), levels_(levels), level_uses_(level_uses), seed_(seed) {}

  /// Adds a keyframe; the next choice starts a new random order.
  void add();
  void add_uses(std::size_t keyframe, int uses) { keyframes_[keyframe].left += uses; }
  /// Chooses a keyframe and counts it as used. There must be at least one keyframe.
  Choice next(int iteration);
  std::size_t size() const { return keyframes_.size(); }
  /// How often it was chosen.
  int used(std::size_t keyframe) const { return keyframes_[keyframe].used; }

 private:
  struct Entry {
    int left = 0;
    int used = 0;
  };
  int uses_, levels_, level_uses_;
  std::uint64_t seed_;
  std::vector<Entry> keyframes_;
  std::vector<std::size_t> order_;
  std::size_t place_ = 0;
};

}  // namespace splatboost
