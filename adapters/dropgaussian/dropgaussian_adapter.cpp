// SPDX-License-Identifier: Apache-2.0
#include "dropgaussian/dropgaussian_adapter.h"

namespace splatboost {

VanillaBoost dropgaussian_boost() {
  VanillaBoost boost;
  boost.published_iterations = kDropGaussianIterations;
  boost.densify_until = kDropGaussianIterations;
  // Few views leave gradients that no other view contradicts: splitting needs a clearer sign of detail.
  boost.gradient_abs_threshold = 2.4e-3;
  // Once, after the last reset of opacities but one has been made good.
  boost.late_prune_from = 5000;
  boost.late_prune_interval = 8000;
  // The supplement (Sec. 9.2) trains it with plain Adam.
  boost.schedule = false;
  return boost;
}

}  // namespace splatboost
