// SPDX-License-Identifier: Apache-2.0
#include "device/device_view.h"
#include "device/launch.h"
#include "octree_gs/usable_anchors.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kBlockThreads)
    usable_anchors_kernel(LevelsInUse rule, DeviceView<const float> positions, DeviceView<const float> levels,
                          DeviceView<const float> extra_levels, DeviceView<std::uint8_t> usable) {
  const std::size_t i = element_index();
  if (i >= usable.size()) return;
  const float position[3] = {positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]};
  usable[i] = is_usable(rule, position, levels[i], extra_levels[i]) ? 1 : 0;
}

}  // namespace

void usable_anchors(const LevelsInUse& rule, std::span<const float> positions, std::span<const float> levels,
                    std::span<const float> extra_levels, std::span<std::uint8_t> usable, CudaStream& stream) {
  launch_each(stream, "usable_anchors", usable_anchors_kernel, usable.size(), rule, positions, levels, extra_levels,
              usable);
}

}  // namespace splatboost::cuda
