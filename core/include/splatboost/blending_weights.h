// SPDX-License-Identifier: Apache-2.0
/// @file How much of the pictures each primitive makes up.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "splatboost/array.h"
#include "splatboost/device.h"
#include "splatboost/hooks.h"
#include "splatboost/random.h"

namespace splatboost {

/// Sums blending weights over training views. Owns the workspace.
class BlendingWeights {
 public:
  explicit BlendingWeights(Device device) : view_weights_(device) {}
  /// Draws min(views, those there are) views without replacement and renders each once.
  /// @return [N] blending weights of each primitive, in units of kWeightUnit, a mean over the views with any; 0 where
  ///   none has. In memory of the host, until the next call.
  std::span<const double> mean(RasterizerHook& rasterizer, int views, const RandomStream& random);

 private:
  Array<std::int32_t> view_weights_;
  std::vector<std::int32_t> copy_;
  std::vector<std::int32_t> seen_;  ///< views with any
  std::vector<double> mean_;
};

}  // namespace splatboost
