// SPDX-License-Identifier: Apache-2.0
#include "common/parameter_group.h"

#include <algorithm>

#include "common/input_error.h"
#include "splatboost/rows.h"

namespace splatboost {

void ParameterGroup::assign(std::vector<float> new_values) {
  values = std::move(new_values);
  gradients.assign(values.size(), 0.0f);
  first_moments.assign(values.size(), 0.0f);
  second_moments.assign(values.size(), 0.0f);
  pending = false;
}

void ParameterGroup::step(const AdamOptions& options, Threads& threads) {
  if (!pending) return;
  adam_step(values, gradients, first_moments, second_moments, ++steps, options, threads);
  pending = false;
}

void ParameterGroup::forget_moments() {
  std::fill(first_moments.begin(), first_moments.end(), 0.0f);
  std::fill(second_moments.begin(), second_moments.end(), 0.0f);
}

void ParameterGroup::remove(std::span<const std::uint8_t> removed) {
  for (std::vector<float>* tensor : {&values, &gradients, &first_moments, &second_moments}) {
    remove_rows(*tensor, width, removed);
  }
}

void ParameterGroup::append_copies(std::span<const std::uint32_t> source_rows) {
  append_rows(values, width, source_rows);
  for (std::vector<float>* tensor : {&gradients, &first_moments, &second_moments}) {
    append_zero_rows(*tensor, width, source_rows.size());
  }
}

void ParameterGroup::reorder(std::span<const std::uint32_t> order) {
  for (std::vector<float>* tensor : {&values, &gradients, &first_moments, &second_moments}) {
    reorder_rows(*tensor, width, order);
  }
}

void ParameterGroup::save(ArchiveWriter& archive) const {
  archive.put(name + ".values", std::span<const float>(values));
  archive.put(name + ".gradients", std::span<const float>(gradients));
  archive.put(name + ".first_moments", std::span<const float>(first_moments));
  archive.put(name + ".second_moments", std::span<const float>(second_moments));
  archive.put(name + ".steps", steps);
  archive.put(name + ".pending", std::int64_t{pending});
}

void ParameterGroup::load(const ArchiveReader& archive) {
  values = archive.floats(name + ".values");
  gradients = archive.floats(name + ".gradients");
  first_moments = archive.floats(name + ".first_moments");
  second_moments = archive.floats(name + ".second_moments");
  steps = archive.integer(name + ".steps");
  pending = archive.integer(name + ".pending") != 0;
  const std::size_t size = values.size();
  if (size % width != 0 || gradients.size() != size || first_moments.size() != size || second_moments.size() != size) {
    throw InputError(archive.path().string() + ": the tensors of '" + name +
                     "' do not fit together; the checkpoint is damaged");
  }
}

}  // namespace splatboost
