// SPDX-License-Identifier: Apache-2.0
/// @file The interface of an adapter: the hooks that accelerate a backbone.
#pragma once

#include <optional>

#include "splatboost/hooks.h"

namespace splatboost {

/// Makes the decisions of an accelerated run. Installed by set_hooks(&adapter, &adapter), after
/// rasterizer_hook().set_beta(adapter.beta()).
class Adapter : public DensityHook, public OptimizerHook {
 public:
  /// β of the compact box; nullopt: the backbone's own box.
  virtual std::optional<float> beta() const = 0;
};

}  // namespace splatboost
