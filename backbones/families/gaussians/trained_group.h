// SPDX-License-Identifier: Apache-2.0
/// @file A group of parameters as the trainer of explicit Gaussians trains it: 3DGS's six, and those of a method.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "trainer/backbone_api/parameter_group.h"

namespace splatboost {

/// What becomes of the values before they are drawn.
enum class Activation { none, exponential, sigmoid };

enum class GroupShape {
  rows,   ///< one row a Gaussian, in their order: growth copies rows, removal and new numbering move them
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
