// SPDX-License-Identifier: Apache-2.0
#include "trainer/backbone_api/parameter_group.h"

#include <algorithm>

#include "splatboost/rows.h"
#include "trainer/support/input_error.h"

namespace splatboost {

void ParameterGroup::assign(std::vector<float> new_values) {
  values.assign(std::move(new_values));
  gradients.assign_zeros(values.size());
  first_moments.assign_zeros(values.size());
  second_moments.assign_zeros(values.size());
  pending = false;
}

void ParameterGroup::step(const AdamOptions& options, Device device) {
  if (!pending) return;
  adam_step(values, gradients, first_moments, second_moments, ++steps, options, device);
  pending = false;
}

void ParameterGroup::forget_moments() {
  first_moments.assign_zeros(first_moments.size());
  second_moments.assign_zeros(second_moments.size());
}

void ParameterGroup::select(std::span<const std::uint32_t> rows, Array<float>& workspace) {
  for (Array<float>* tensor : {&values, &gradients, &first_moments, &second_moments}) {
    select_rows(*tensor, width, rows, workspace);
  }
}

void ParameterGroup::reserve_rows(std::size_t rows) {
  for (Array<float>* tensor : {&values, &gradients, &first_moments, &second_moments}) tensor->reserve(width * rows);
}

void ParameterGroup::append_copies(std::span<const std::uint32_t> source_rows) {
  append_rows(values, width, source_rows);
  for (Array<float>* tensor : {&gradients, &first_moments, &second_moments}) {
    append_zero_rows(*tensor, width, source_rows.size());
  }
}

void ParameterGroup::save(ArchiveWriter& archive) const {
  std::vector<float> copy;
  archive.put(name + ".values", values.on_host(copy));
  archive.put(name + ".gradients", gradients_on_host(copy));
  archive.put(name + ".first_moments", first_moments.on_host(copy));
  archive.put(name + ".second_moments", second_moments.on_host(copy));
  archive.put(name + ".steps", steps);
  archive.put(name + ".pending", std::int64_t{pending});
}

void ParameterGroup::load(const ArchiveReader& archive) {
  values.assign(archive.floats(name + ".values"));
  gradients.assign(archive.floats(name + ".gradients"));
  first_moments.assign(archive.floats(name + ".first_moments"));
  second_moments.assign(archive.floats(name + ".second_moments"));
  steps = archive.integer(name + ".steps");
  pending = archive.integer(name + ".pending") != 0;
  const std::size_t size = values.size();
  if (size % width != 0 || gradients.size() != size || first_moments.size() != size || second_moments.size() != size) {
    throw InputError(archive.path().string() + ": the tensor sizes of '" + name +
                     "' do not match; the checkpoint is damaged");
  }
}

}  // namespace splatboost
