// SPDX-License-Identifier: Apache-2.0
#include "photo_slam/keyframe_schedule.h"

#include <algorithm>
#include <numeric>

#include "splatboost/random.h"

namespace splatboost {

void KeyframeSchedule::add() {
  keyframes_.push_back({uses_, 0});
  order_.clear();
}

KeyframeSchedule::Choice KeyframeSchedule::next(int iteration) {
  const std::size_t n = keyframes_.size();
  if (order_.size() != n) {
    order_.resize(n);
    std::iota(order_.begin(), order_.end(), std::size_t{0});
    const RandomStream random(seed_, static_cast<std::uint64_t>(iteration), RandomPurpose::view_order);
    for (std::size_t i = n; i > 1; --i) std::swap(order_[i - 1], order_[random.below(i, i)]);
    place_ = 0;
  }
  if (std::ranges::none_of(keyframes_, [](const Entry& entry) { return entry.left > 0; })) {
    for (Entry& entry : keyframes_) ++entry.left;
  }
  while (keyframes_[order_[place_ % n]].left <= 0) ++place_;
  const std::size_t keyframe = order_[place_++ % n];
  place_ %= n;
  Entry& entry = keyframes_[keyframe];
  const int passed = level_uses_ > 0 ? entry.used / level_uses_ : levels_;
  --entry.left;
  ++entry.used;
  return {keyframe, std::max(0, levels_ - passed)};
}

}  // namespace splatboost
