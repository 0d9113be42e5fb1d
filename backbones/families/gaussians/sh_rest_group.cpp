// SPDX-License-Identifier: Apache-2.0
#include "families/gaussians/sh_rest_group.h"

#include <utility>

namespace splatboost {

void ShRestGroup::receive(GaussianGradients& pass, int sh_degree, bool steps_soon) {
  const bool wants_factors = views_ > 0 || (!device_.is_cuda() && !pending && steps_soon);
  if (wants_factors && views_ < kMaxViews) {
    const std::size_t plane = kShFactors * rows();
    pass.sh_factors = gradients.span().subspan(plane * views_, plane);
    degrees_[views_++] = sh_degree;
    holds_factors_ = true;
    return;
  }
  expand();
  if (holds_factors_) gradients.assign_zeros(values.size());
  holds_factors_ = false;
  pass.sh_rest = gradients;
}

void ShRestGroup::expand() {
  if (views_ == 0) return;
  gradients.assign(expanded());
  forget_factors();
}

void ShRestGroup::assign(std::vector<float> new_values) {
  forget_factors();
  TrainedGroup::assign(std::move(new_values));
}

void ShRestGroup::step(const AdamOptions& options, Device device) {
  if (views_ == 0) return TrainedGroup::step(options, device);
  Views memory;
  adam_step_sh(values, kRestRows, views(memory), first_moments, second_moments, ++steps, options, device.threads());
  views_ = 0;
  pending = false;
}

void ShRestGroup::load(const ArchiveReader& archive) {
  forget_factors();
  TrainedGroup::load(archive);
}

void ShRestGroup::forget_factors() {
  views_ = 0;
  holds_factors_ = false;
}

std::span<const float> ShRestGroup::gradients_on_host(std::vector<float>& copy) const {
  if (!holds_factors_) return TrainedGroup::gradients_on_host(copy);
  copy = expanded();
  return copy;
}

std::vector<float> ShRestGroup::expanded() const {
  Views memory;
  std::vector<float> sum(values.size());
  sum_sh_gradients(views(memory), kRestRows, sum, device_.threads());
  return sum;
}

std::span<const ShFactors> ShRestGroup::views(Views& memory) const {
  const std::size_t plane = kShFactors * rows();
  for (std::size_t i = 0; i < views_; ++i) memory[i] = {gradients.span().subspan(plane * i, plane), degrees_[i]};
  return std::span(memory).first(views_);
}

}  // namespace splatboost
