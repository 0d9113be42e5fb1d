// SPDX-License-Identifier: Apache-2.0
/// @file A group of parameters as trainers train it: how its values become what is drawn, and how far it steps.
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

/// What becomes of the values before they are drawn.
enum class Activation { none, exponential, sigmoid };

enum class GroupShape {
  rows,   ///< one row a primitive, in their order: growth copies rows, removal and new numbering move them
  dense,  ///< a block of a size of its own (a net's weights), which density control leaves alone
};

/// The trainer activates, steps, saves and loads it. The optimizer hook sees its name.
struct TrainedGroup : ParameterGroup {
  GroupShape shape;
  std::function<double(int iteration)> rate;  ///< of Adam's step
  Activation activation;
  bool in_model = true;    ///< false: of training alone; models are without it
  Array<float> activated;  ///< kept by the trainer where there is an activation

  /// @param group_name unique, of the model's files and checkpoints too
  TrainedGroup(std::string group_name, std::size_t row_width, Device device, std::function<double(int)> rate_at,
               Activation activated_by = Activation::none, GroupShape of = GroupShape::rows)
      : ParameterGroup(std::move(group_name), row_width, device),
        shape(of),
        rate(std::move(rate_at)),
        activation(activated_by),
        activated(device) {}

  /// What is drawn, and what `gradients` are of until a step.
  std::span<const float> drawn() const { return activation == Activation::none ? values.span() : activated.span(); }
};

/// Sets `activated` of those that have an activation.
void activate(std::span<TrainedGroup* const> groups, Device device);

/// One Adam step with what has accumulated; does nothing if nothing has. Where there is an activation, `gradients` are
/// of activated values, which must not have changed since the last step of the group.
/// @param hook null: none @return whether it stepped
bool step_group(TrainedGroup& group, OptimizerHook* hook, Moment moment, Device device);
/// Of all. @return whether any stepped
bool step_groups(std::span<TrainedGroup* const> groups, OptimizerHook* hook, Moment moment, Device device);
/// Of those whose time has come by the hook.
bool step_due_groups(std::span<TrainedGroup* const> groups, OptimizerHook* hook, Moment moment, Device device);

/// Leaves in each of the groups the rows that the list names, in its order.
/// @param workspace of the groups' device; room for the widest tensor is made before anything changes, so that the
/// model stays whole where memory is short
void select_rows(std::span<TrainedGroup* const> groups, const Array<std::uint32_t>& rows, Array<float>& workspace,
                 Device device);

/// Leaves out the entries of what is removed; a list of another length, of another moment, stays as it is.
/// @param removed [N] non-zero = gone
/// @param list [N] of the host, one entry a row
void drop_removed(std::span<const std::uint8_t> removed, std::vector<std::uint32_t>& list);

}  // namespace splatboost
