// SPDX-License-Identifier: Apache-2.0
#include "families/anchors/anchor_prefilter.h"

#include "families/anchors/anchor_prefilter_math.h"

namespace splatboost {
namespace {

constexpr std::size_t kGrain = 2048;

}  // namespace

void anchors_in_view(const Camera& camera, std::span<const float> positions, std::span<const float> scales,
                     std::span<const std::uint8_t> candidates, const Threads& threads, std::vector<std::uint8_t>& mask,
                     std::vector<std::uint32_t>& visible) {
  const std::size_t n = positions.size() / 3;
  mask.resize(n);
  const AnchorScreen screen(camera);
  threads.for_range(n, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const bool may = candidates.empty() || candidates[i] != 0;
      mask[i] = may && sees_anchor(screen, &positions[3 * i], &scales[6 * i]) ? 1 : 0;
    }
  });
  visible.clear();
  for (std::size_t i = 0; i < n; ++i) {
    if (mask[i] != 0) visible.push_back(static_cast<std::uint32_t>(i));
  }
}

}  // namespace splatboost
