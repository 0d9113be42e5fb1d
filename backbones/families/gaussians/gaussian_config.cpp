// SPDX-License-Identifier: Apache-2.0
#include "families/gaussians/gaussian_config.h"

#include "trainer/support/input_error.h"

namespace splatboost {

void check_gaussian_config(const GaussianConfig& config, const std::string& backbone) {
  const std::string what = "config of backbone " + backbone + ": ";
  require(config.sh_degree >= 0 && config.sh_degree <= 3, what + "sh_degree must be 0 to 3");
  require(config.position_rate_initial > 0 && config.position_rate_final > 0,
          what + "learning rates of positions must be above 0");
  require(config.feature_rate >= 0 && config.opacity_rate >= 0 && config.scaling_rate >= 0 && config.rotation_rate >= 0,
          what + "learning rates must not be negative");
  require(config.gradient_threshold >= 0 && config.percent_dense >= 0 && config.max_world_scale >= 0,
          what + "gradient_threshold, percent_dense and max_world_scale must not be negative");
  require(config.min_opacity >= 0 && config.min_opacity < 1, what + "min_opacity must lie in [0, 1)");
  require(config.lambda_dssim >= 0 && config.lambda_dssim <= 1, what + "lambda_dssim must lie in [0, 1]");
  require(config.initial_opacity > 0 && config.initial_opacity < 1, what + "initial_opacity must lie in (0, 1)");
  require(config.reset_opacity > 0 && config.reset_opacity < 1, what + "reset_opacity must lie in (0, 1)");
  require(config.densify_interval > 0 && config.opacity_reset_interval > 0 && config.sh_interval > 0,
          what + "intervals must be above 0");
  require(config.densify_interval <= 100'000'000, what + "densify_interval must be at most 100000000");
  require(config.densify_from >= 0 && config.densify_until >= 0,
          what + "densify_from and densify_until must not be negative");
}

}  // namespace splatboost
