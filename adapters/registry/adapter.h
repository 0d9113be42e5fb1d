// SPDX-License-Identifier: Apache-2.0
/// @file What plugs into a backbone.
#pragma once

#include <optional>

#include "splatboost/hooks.h"

namespace splatboost {

/// The decisions of an accelerated run. Plug it in by set_hooks(&adapter, &adapter) after
/// rasterizer_hook().set_beta(adapter.beta()).
class Adapter : public DensityHook, public OptimizerHook {
 public:
  /// β of the compact box; nullopt: the backbone's own box.
  virtual std::optional<float> beta() const = 0;
};

}  // namespace splatboost
