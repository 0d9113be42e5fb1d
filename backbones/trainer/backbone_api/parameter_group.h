// SPDX-License-Identifier: Apache-2.0
/// @file Trainable rows with their gradients and Adam moments; densification and pruning change them together.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "splatboost/adam.h"
#include "splatboost/array.h"
#include "splatboost/device.h"
#include "trainer/support/archive.h"

namespace splatboost {

/// One tensor [rows, width] in a device's memory; row lists must be in the same memory. Invariant: values, gradients
/// and moments have the same size, and so have averages, if there are any.
struct ParameterGroup {
  std::string name;
  std::size_t width = 1;
  Array<float> values;
  Array<float> gradients;  ///< accumulate until the next step
  Array<float> first_moments;
  Array<float> second_moments;
  std::int64_t steps = 0;     ///< Adam steps so far
  bool pending = false;       ///< gradients are accumulated but not yet applied
  Array<float> averages;      ///< of the values, for the end of the run; only if `averaged` is not 0
  std::int64_t averaged = 0;  ///< number of values that were averaged

  /// In host memory.
  ParameterGroup(std::string group_name, std::size_t row_width) : name(std::move(group_name)), width(row_width) {}
  ParameterGroup(std::string group_name, std::size_t row_width, Device device)
      : name(std::move(group_name)),
        width(row_width),
        values(device),
        gradients(device),
        first_moments(device),
        second_moments(device),
        averages(device) {}

  virtual ~ParameterGroup() = default;

  std::size_t rows() const { return values.size() / width; }
  /// Replaces the values; gradients and moments restart at zero, and the averages are forgotten.
  virtual void assign(std::vector<float> new_values);
  /// One Adam step with the accumulated gradients; does nothing if there are none.
  virtual void step(const AdamOptions& options, Device device);
  /// Sets moments to zero (3DGS does so for opacities it resets).
  void forget_moments();
  /// Adds the values to the averages.
  void add_to_averages(Device device);
  /// Replaces the values by their averages. @return whether there were any
  bool take_averages();
  void forget_averages();
  /// Keeps the listed rows, in the order of the list (rows.h).
  void select(std::span<const std::uint32_t> rows, Array<float>& workspace);
  /// Reserves memory for `rows` rows in total; if it runs out, the group is unchanged.
  void reserve_rows(std::size_t rows);
  /// Appends copies of the listed rows; their gradients and moments are zero. There must be no averages.
  void append_copies(std::span<const std::uint32_t> source_rows);
  void save(ArchiveWriter& archive) const;
  virtual void load(const ArchiveReader& archive);

 protected:
  /// The accumulated gradients [rows, width] in host memory: they themselves, or in `copy`.
  virtual std::span<const float> gradients_on_host(std::vector<float>& copy) const { return gradients.on_host(copy); }
};

}  // namespace splatboost
