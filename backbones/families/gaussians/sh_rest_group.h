// SPDX-License-Identifier: Apache-2.0
/// @file The coefficients of higher SH bands, three quarters of all parameters.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "splatboost/device.h"
#include "splatboost/gaussians.h"
#include "splatboost/sh_factors.h"
#include "trainer/backbone_api/trained_group.h"

namespace splatboost {

inline constexpr int kRestRows = 15;  ///< spherical harmonics above degree 0

/// On the CPU, gradients are kept as factors (sh_factors.h) in the memory of `gradients`, if a step follows soon: a
/// backward pass writes 6 numbers per Gaussian then, not 45. The results are the same to the bit.
struct ShRestGroup final : TrainedGroup {
  /// Number of views whose factors fit into the memory of the gradients.
  static constexpr std::size_t kMaxViews = 3 * static_cast<std::size_t>(kRestRows) / kShFactors;

  ShRestGroup(Device device, std::function<double(int)> rate_at)
      : TrainedGroup("f_rest", 3 * static_cast<std::size_t>(kRestRows), device, std::move(rate_at)), device_(device) {}

  /// Sets where a backward pass writes its gradients of these coefficients.
  /// @param sh_degree of the render
  /// @param steps_soon whether a step follows within about kMaxViews views; more of them become gradients
  void receive(GaussianGradients& pass, int sh_degree, bool steps_soon);
  /// Replaces factors by gradients: before rows are added, removed or moved.
  void expand();

  void assign(std::vector<float> new_values) override;
  void step(const AdamOptions& options, Device device) override;
  void load(const ArchiveReader& archive) override;

 private:
  using Views = std::array<ShFactors, kMaxViews>;

  std::span<const float> gradients_on_host(std::vector<float>& copy) const override;
  std::vector<float> expanded() const;
  void forget_factors();
  /// The views whose factors wait for a step. @param memory of the result
  std::span<const ShFactors> views(Views& memory) const;

  Device device_;
  std::array<int, kMaxViews> degrees_{};  ///< of these views
  std::size_t views_ = 0;                 ///< their number
  bool holds_factors_ = false;            ///< `gradients` holds factors: those of these views, or of an earlier step
};

}  // namespace splatboost
