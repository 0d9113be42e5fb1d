// SPDX-License-Identifier: Apache-2.0
/// @file The deformation field on the CPU. Real is float, or double for tests of gradients.
#pragma once

#include <span>
#include <vector>

#include "deformable_3dgs/deformation_field.h"
#include "families/nets/deep_net.h"
#include "splatboost/threads.h"

namespace splatboost {

/// See DeformationField.
template <class Real>
class DeformationOnCpu {
 public:
  DeformationOnCpu(const DeformationShape& shape, const Threads& threads);

  void forward(std::span<const Real> parameters, const GaussianPlaces<const Real>& at, Real time,
               const GaussianPlaces<Real>& moved, bool keep);
  void backward(std::span<const Real> parameters, const GaussianPlaces<const Real>& at,
                const GaussianPlaces<const Real>& given, const GaussianPlaces<Real>& of_gaussians,
                std::span<Real> of_parameters);

 private:
  void encode_time(std::span<const Real> parameters, Real time);
  void encode_time_backward(std::span<const Real> parameters, std::span<Real> of_parameters);

  DeformationShape shape_;
  DeepNetShape net_shape_;
  NetShape time_shape_;
  Threads threads_;
  DeepNet<Real> net_;
  std::vector<Real> time_inputs_, time_hidden_, time_outputs_;  ///< of the time net, kTimeRows rows
  std::vector<Real> shared_, of_shared_;                        ///< shared inputs of the net, and their gradients
  std::vector<Real> deltas_, of_deltas_;                        ///< [N, delta_width()]
  std::vector<Real> scratch_;
};

}  // namespace splatboost
