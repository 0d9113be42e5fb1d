// SPDX-License-Identifier: Apache-2.0
#include "families/gaussians/trained_group.h"

#include <algorithm>

namespace splatboost {

void select_rows(std::span<TrainedGroup* const> groups, const Array<std::uint32_t>& rows, Array<float>& workspace,
                 Device device) {
  std::size_t widest = 0;
  for (const TrainedGroup* group : groups) widest = std::max(widest, group->width);
  if (device.is_cuda()) workspace.ensure(rows.size() * widest);  // the CPU needs none
  for (TrainedGroup* group : groups) group->select(rows, workspace);
}

void drop_removed(std::span<const std::uint8_t> removed, std::vector<std::uint32_t>& list) {
  if (list.size() != removed.size()) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < removed.size(); ++i) {
    if (removed[i] == 0) list[kept++] = list[i];
  }
  list.resize(kept);
}

}  // namespace splatboost
