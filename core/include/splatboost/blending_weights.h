// SPDX-License-Identifier: Apache-2.0
/// @file How much each primitive contributes to rendered images.
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
  /// Draws `views` of the scorable views without replacement (all, if there are fewer) and renders each once.
  /// @return [N] blending weight of each primitive, in units of kWeightUnit: the mean over the views where it is not
  ///   zero; 0 if there is none. In host memory, valid until the next call.
  std::span<const double> mean(RasterizerHook& rasterizer, int views, const RandomStream& random);

 private:
  Array<std::int32_t> view_weights_;
  std::vector<std::int32_t> copy_;
  std::vector<std::int32_t> seen_;  ///< number of views where the weight is not zero
  std::vector<double> mean_;
};

}  // namespace splatboost
