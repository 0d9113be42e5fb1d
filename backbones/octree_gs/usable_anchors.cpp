// SPDX-License-Identifier: Apache-2.0
#include "octree_gs/usable_anchors.h"

namespace splatboost {
namespace {
constexpr std::size_t kGrain = 1024;
}

void usable_anchors(const LevelsInUse& rule, std::span<const float> positions, std::span<const float> levels,
                    std::span<const float> extra_levels, std::span<std::uint8_t> usable, Device device) {
  if (device.is_cuda()) return cuda::usable_anchors(rule, positions, levels, extra_levels, usable, device.stream());
  device.threads().for_range(usable.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      usable[i] = is_usable(rule, &positions[3 * i], levels[i], extra_levels[i]) ? 1 : 0;
    }
  });
}

}  // namespace splatboost
