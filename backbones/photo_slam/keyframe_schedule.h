// SPDX-License-Identifier: Apache-2.0
/// @file Which keyframe, at which size, an iteration of the mapper trains on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace splatboost {

/// Photo-SLAM's: keyframes are walked through in random order; each has a number of uses left, and those without are
/// passed over. When none has any, all get one. The first uses of a keyframe are of the levels of its pyramid, the
/// smallest first.
class KeyframeSchedule {
 public:
  struct Choice {
    std::size_t keyframe = 0;
    int level = 0;  ///< halvings of its image; 0: full size
  };

  /// @param uses that a new keyframe is entitled to @param levels of its pyramid @param level_uses of each of these
  KeyframeSchedule(int uses, int levels, int level_uses, std::uint64_t seed)
      : uses_(uses), levels_(levels), level_uses_(level_uses), seed_(seed) {}

  /// One keyframe more; a new random order begins with the next choice.
  void add();
  void add_uses(std::size_t keyframe, int uses) { keyframes_[keyframe].left += uses; }
  /// Counts as a use of it. There must be a keyframe.
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
