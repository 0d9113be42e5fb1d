// SPDX-License-Identifier: Apache-2.0
/// @file A parameter group with its activation and its learning rate.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "splatboost/hooks.h"
#include "trainer/backbone_api/parameter_group.h"

namespace splatboost {

/// Applied to the values before rendering.
enum class Activation { none, exponential, sigmoid };

enum class GroupShape {
  rows,   ///< one row per primitive, in order: densification copies rows, pruning and reordering move them
  dense,  ///< a block of any size (network weights), unaffected by density control
};

/// The trainer activates, steps, saves and loads it. The optimizer hook identifies it by its name.
struct TrainedGroup : ParameterGroup {
  GroupShape shape;
  std::function<double(int iteration)> rate;  ///< learning rate of Adam
  Activation activation;
  bool in_model = true;    ///< false: used in training only, not part of exported models
  Array<float> activated;  ///< kept by the trainer; unused without an activation

  /// @param group_name unique; also used in model files and checkpoints
  TrainedGroup(std::string group_name, std::size_t row_width, Device device, std::function<double(int)> rate_at,
               Activation activated_by = Activation::none, GroupShape of = GroupShape::rows)
      : ParameterGroup(std::move(group_name), row_width, device),
        shape(of),
        rate(std::move(rate_at)),
        activation(activated_by),
        activated(device) {}

  /// The values that are rendered; until a step, `gradients` are with respect to them.
  std::span<const float> drawn() const { return activation == Activation::none ? values.span() : activated.span(); }
};

/// Computes `activated` of the groups that have an activation.
void activate(std::span<TrainedGroup* const> groups, Device device);

/// One Adam step with the accumulated gradients; does nothing if there are none. With an activation, `gradients` are
/// with respect to `activated`, which must not have changed since the group's last step.
/// @param hook null: none @return whether it stepped
bool step_group(TrainedGroup& group, OptimizerHook* hook, Moment moment, Device device);
/// Steps all groups. @return whether any stepped
bool step_groups(std::span<TrainedGroup* const> groups, OptimizerHook* hook, Moment moment, Device device);
/// Steps the groups that are due at this moment according to the hook. @return whether any stepped
bool step_due_groups(std::span<TrainedGroup* const> groups, OptimizerHook* hook, Moment moment, Device device);

/// Adds the values of all groups to their averages if the hook says so; to be called after the steps. If the device has
/// too little memory for averages, the groups have none: a run can do without.
void average_if_due(std::span<TrainedGroup* const> groups, const OptimizerHook* hook, Moment moment, Device device);
/// For values that are set rather than stepped, and for rows that are added: means with earlier values would mean
/// nothing.
void forget_averages(std::span<TrainedGroup* const> groups);
/// Replaces the values of all groups by their averages, where there are any. @return whether any had them
bool take_averages(std::span<TrainedGroup* const> groups);

/// Keeps the listed rows in each group, in the order of the list.
/// @param workspace in the groups' device memory; it is grown for the widest tensor before anything changes, so that
/// the model stays intact if memory runs out. Not used where rows move in place
void select_rows(std::span<TrainedGroup* const> groups, const Array<std::uint32_t>& rows, Array<float>& workspace,
                 Device device);

/// Drops the entries of removed primitives; a list of another length belongs to another state and is left unchanged.
/// @param removed [N] non-zero: removed
/// @param list [N] in host memory, one entry per row
void drop_removed(std::span<const std::uint8_t> removed, std::vector<std::uint32_t>& list);

}  // namespace splatboost
