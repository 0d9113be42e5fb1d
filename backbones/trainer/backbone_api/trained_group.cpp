// SPDX-License-Identifier: Apache-2.0
#include "trainer/backbone_api/trained_group.h"

#include <algorithm>

#include "splatboost/activations.h"
#include "splatboost/errors.h"
#include "splatboost/rows.h"

namespace splatboost {

void activate(std::span<TrainedGroup* const> groups, Device device) {
  for (TrainedGroup* group : groups) {
    if (group->activation == Activation::none) continue;
    group->activated.ensure(group->values.size());
    const auto activate_values = group->activation == Activation::exponential ? exponentials : sigmoids;
    activate_values(group->values, group->activated, device);
  }
}

bool step_group(TrainedGroup& group, OptimizerHook* hook, Moment moment, Device device) {
  if (!group.pending) return false;
  if (group.activation == Activation::exponential) exponential_gradients(group.activated, group.gradients, device);
  if (group.activation == Activation::sigmoid) sigmoid_gradients(group.activated, group.gradients, device);
  AdamOptions options;
  options.learning_rate = static_cast<float>(group.rate(moment.iteration));
  if (hook != nullptr) options.learning_rate *= hook->rate_factor(group.name, moment);
  group.step(options, device);
  return true;
}

bool step_groups(std::span<TrainedGroup* const> groups, OptimizerHook* hook, Moment moment, Device device) {
  bool stepped = false;
  for (TrainedGroup* group : groups) stepped = step_group(*group, hook, moment, device) || stepped;
  return stepped;
}

bool step_due_groups(std::span<TrainedGroup* const> groups, OptimizerHook* hook, Moment moment, Device device) {
  bool stepped = false;
  for (TrainedGroup* group : groups) {
    if (hook != nullptr && !hook->steps_at(group->name, moment)) continue;
    stepped = step_group(*group, hook, moment, device) || stepped;
  }
  return stepped;
}

void average_if_due(std::span<TrainedGroup* const> groups, const OptimizerHook* hook, Moment moment, Device device) {
  if (hook == nullptr || !hook->averages_at(moment)) return;
  try {
    for (TrainedGroup* group : groups) group->add_to_averages(device);
  } catch (const DeviceMemoryError&) {
    forget_averages(groups);
    for (TrainedGroup* group : groups) group->averages = Array<float>(device);  // frees the memory
  }
}

void forget_averages(std::span<TrainedGroup* const> groups) {
  for (TrainedGroup* group : groups) group->forget_averages();
}

bool take_averages(std::span<TrainedGroup* const> groups) {
  bool taken = false;
  for (TrainedGroup* group : groups) taken = group->take_averages() || taken;
  return taken;
}

void select_rows(std::span<TrainedGroup* const> groups, const Array<std::uint32_t>& rows, Array<float>& workspace,
                 Device device) {
  std::size_t widest = 0;
  for (const TrainedGroup* group : groups) widest = std::max(widest, group->width);
  const bool in_place = !device.is_cuda() && rows_ascend(rows);
  if (!in_place && workspace.size() < rows.size() * widest) workspace.ensure(rows.size() * widest);
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
