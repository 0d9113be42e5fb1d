// SPDX-License-Identifier: Apache-2.0
#include "deformable_3dgs/deformation_on_cpu.h"

#include <algorithm>
#include <functional>

#include "deformable_3dgs/deformation_math.h"
#include "families/nets/frequency_encoding.h"

namespace splatboost {
namespace {

constexpr std::size_t kGrain = 1024;
/// The time net needs one row. A second row with a zero gradient is added, because Eigen computes products of a single
/// row by another method, whose rounding depends on the address.
constexpr std::size_t kTimeRows = 2;

template <class Real>
GaussianRow<Real> row_of(const GaussianPlaces<Real>& places, std::size_t i) {
  return {&places.means[3 * i], &places.scales[3 * i], &places.rotations[4 * i]};
}

}  // namespace

template <class Real>
DeformationOnCpu<Real>::DeformationOnCpu(const DeformationShape& shape, const Threads& threads)
    : shape_(shape),
      net_shape_(shape.net()),
      time_shape_(shape.time_shape()),
      threads_(threads),
      net_(net_shape_, threads),
      shared_(net_shape_.shared),
      of_shared_(net_shape_.shared) {}

template <class Real>
void DeformationOnCpu<Real>::encode_time(std::span<const Real> parameters, Real time) {
  const std::size_t width = encoded_width(1, shape_.time_frequencies);
  time_inputs_.resize(kTimeRows * width);
  for (std::size_t row = 0; row < kTimeRows; ++row) {
    encode_number(time, std::span(time_inputs_).subspan(row * width, width));
  }
  if (!shape_.time_net) {
    std::copy_n(time_inputs_.begin(), width, shared_.begin());
    return;
  }
  time_hidden_.resize(kTimeRows * time_shape_.hidden);
  time_outputs_.resize(kTimeRows * time_shape_.outputs);
  net_forward(time_shape_, parameters.subspan(net_shape_.parameters()), kTimeRows,
              static_cast<const Real*>(time_inputs_.data()), time_hidden_.data(), time_outputs_.data());
  std::copy_n(time_outputs_.begin(), time_shape_.outputs, shared_.begin());
}

template <class Real>
void DeformationOnCpu<Real>::encode_time_backward(std::span<const Real> parameters, std::span<Real> of_parameters) {
  if (!shape_.time_net) return;
  scratch_.assign(kTimeRows * (time_shape_.outputs + time_shape_.hidden + time_shape_.inputs), Real(0));
  std::copy(of_shared_.begin(), of_shared_.end(), scratch_.begin());
  Real* const of_hidden = scratch_.data() + kTimeRows * time_shape_.outputs;
  net_backward(time_shape_, parameters.subspan(net_shape_.parameters()), kTimeRows,
               static_cast<const Real*>(time_inputs_.data()), static_cast<const Real*>(time_hidden_.data()),
               static_cast<const Real*>(scratch_.data()), of_hidden, of_parameters.subspan(net_shape_.parameters()),
               of_hidden + kTimeRows * time_shape_.hidden);
}

template <class Real>
void DeformationOnCpu<Real>::forward(std::span<const Real> parameters, const GaussianPlaces<const Real>& at, Real time,
                                     const GaussianPlaces<Real>& moved, bool keep) {
  const std::size_t n = at.means.size() / 3, motion = shape_.motion(), width = delta_width(motion);
  encode_time(parameters, time);
  deltas_.resize(n * width);
  const auto encode = [&](std::size_t begin, std::size_t end, Real* x) {
    encode_positions(end - begin, shape_.position_frequencies, &at.means[3 * begin], x);
  };
  // By reference: converting a copy to std::function would allocate at every call.
  net_.forward(parameters.first(net_shape_.parameters()), shared_, n, std::cref(encode), deltas_, keep);
  threads_.for_range(n, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      move_gaussian<Real>(motion, row_of(at, i), &deltas_[width * i], row_of(moved, i));
    }
  });
}

template <class Real>
void DeformationOnCpu<Real>::backward(std::span<const Real> parameters, const GaussianPlaces<const Real>& at,
                                      const GaussianPlaces<const Real>& given, const GaussianPlaces<Real>& of_gaussians,
                                      std::span<Real> of_parameters) {
  const std::size_t n = at.means.size() / 3, motion = shape_.motion(), width = delta_width(motion);
  of_deltas_.resize(n * width);
  threads_.for_range(n, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      move_gaussian_backward<Real>(motion, row_of(at, i), &deltas_[width * i], row_of(given, i), &of_deltas_[width * i],
                                   row_of(of_gaussians, i));
    }
  });
  net_.backward(parameters.first(net_shape_.parameters()), shared_, of_deltas_,
                of_parameters.first(net_shape_.parameters()), of_shared_);
  encode_time_backward(parameters, of_parameters);
}

template class DeformationOnCpu<float>;
template class DeformationOnCpu<double>;

}  // namespace splatboost
