// SPDX-License-Identifier: Apache-2.0
/// @file Trainable rows with their gradients and Adam moments; they follow clones, splits and removals together.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/archive.h"
#include "splatboost/adam.h"
#include "splatboost/threads.h"

namespace splatboost {

/// One tensor [rows, width]. Invariant: values, gradients and moments have the same size.
struct ParameterGroup {
  std::string name;
  std::size_t width = 1;
  std::vector<float> values;
  std::vector<float> gradients;  ///< accumulate until the next step
  std::vector<float> first_moments;
  std::vector<float> second_moments;
  std::int64_t steps = 0;  ///< Adam steps so far
  bool pending = false;    ///< gradients hold something not yet applied

  ParameterGroup(std::string group_name, std::size_t row_width) : name(std::move(group_name)), width(row_width) {}

  std::size_t rows() const { return values.size() / width; }
  /// Replaces the values; gradients and moments restart at zero.
  void assign(std::vector<float> new_values);
  /// One Adam step with what has accumulated; does nothing if nothing has.
  void step(const AdamOptions& options, Threads& threads);
  /// Sets moments to zero (3DGS does so for opacities it resets).
  void forget_moments();
  void remove(std::span<const std::uint8_t> removed);
  /// Appends copies of rows; their moments and gradients are zero.
  void append_copies(std::span<const std::uint32_t> source_rows);
  /// Puts row order[i] at place i.
  void reorder(std::span<const std::uint32_t> order);
  void save(ArchiveWriter& archive) const;
  void load(const ArchiveReader& archive);
};

}  // namespace splatboost
