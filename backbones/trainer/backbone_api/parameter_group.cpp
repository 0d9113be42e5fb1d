// SPDX-License-Identifier: Apache-2.0
#include "trainer/backbone_api/parameter_group.h"

#include <algorithm>

#include "splatboost/elementwise.h"
#include "splatboost/rows.h"
#include "trainer/support/input_error.h"

namespace splatboost {

void ParameterGroup::assign(std::vector<float> new_values) {
  values.assign(std::move(new_values));
  gradients.assign_zeros(values.size());
  first_moments.assign_zeros(values.size());
  second_moments.assign_zeros(values.size());
  pending = false;
  forget_averages();
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

void ParameterGroup::add_to_averages(Device device) {
  if (averaged == 0) averages.assign_zeros(values.size());
  ++averaged;
  average_in(values, 1.0f / static_cast<float>(averaged), averages, device);
}

bool ParameterGroup::take_averages() {
  if (averaged == 0) return false;
  std::swap(values, averages);
  forget_averages();
  return true;
}

void ParameterGroup::forget_averages() {
  averages.ensure(0);
  averaged = 0;
}

void ParameterGroup::select(std::span<const std::uint32_t> rows, Array<float>& workspace) {
  for (Array<float>* tensor : {&values, &gradients, &first_moments, &second_moments}) {
    select_rows(*tensor, width, rows, workspace);
  }
  if (averaged > 0) select_rows(averages, width, rows, workspace);
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
  archive.put(name + ".averages", averages.on_host(copy));
  archive.put(name + ".averaged", averaged);
}

void ParameterGroup::load(const ArchiveReader& archive) {
  values.assign(archive.floats(name + ".values"));
  gradients.assign(archive.floats(name + ".gradients"));
  first_moments.assign(archive.floats(name + ".first_moments"));
  second_moments.assign(archive.floats(name + ".second_moments"));
  steps = archive.integer(name + ".steps");
  pending = archive.integer(name + ".pending") != 0;
  averages.assign(archive.floats(name + ".averages"));
  averaged = archive.integer(name + ".averaged");
  const std::size_t size = values.size();
  if (size % width != 0 || gradients.size() != size || first_moments.size() != size || second_moments.size() != size ||
      averaged < 0 || averages.size() != (averaged > 0 ? size : 0)) {
    throw InputError(archive.path().string() + ": the tensor sizes of '" + name +
                     "' do not match; the checkpoint is damaged");
  }
}

}  // namespace splatboost
