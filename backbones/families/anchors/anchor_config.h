// SPDX-License-Identifier: Apache-2.0
/// @file Settings shared by Scaffold-GS and Octree-GS, with the values of Scaffold-GS.
#pragma once

#include <string>

#include "trainer/support/input_error.h"

namespace splatboost {

/// typical_depth() and extent of a scene for which the published lengths are: about the medians of captures of objects
/// from all around, in the units that COLMAP gave them.
inline constexpr double kAnchorDepth = 4;
inline constexpr double kAnchorExtent = 5;

/// Iterations are those of the backbone's published run; they scale with the length of the run. A rate with an initial
/// and a final value decays log-linearly over the run.
struct AnchorConfig {
  /// Whether lengths are in world units, as published. If not, they are for a scene seen from kAnchorDepth with the
  /// extent kAnchorExtent, and are scaled by typical_depth().
  bool absolute_distances = true;
  int feat_dim = 32;
  int n_offsets = 10;
  int appearance_dim = 0;
  bool use_feat_bank = false;
  bool add_opacity_dist = false;
  bool add_cov_dist = false;
  bool add_color_dist = false;
  double offset_rate_initial = 0.01;  ///< × scene extent
  double offset_rate_final = 1e-4;    ///< × scene extent
  double feature_rate = 0.0075;
  double scaling_rate = 0.007;
  double opacity_net_rate_initial = 2e-3;
  double opacity_net_rate_final = 2e-5;
  double cov_net_rate_initial = 4e-3;
  double cov_net_rate_final = 4e-3;
  double color_net_rate_initial = 8e-3;
  double color_net_rate_final = 5e-5;
  double feat_bank_rate_initial = 0.01;
  double feat_bank_rate_final = 1e-5;
  double appearance_rate_initial = 0.05;
  double appearance_rate_final = 5e-4;
  double lambda_dssim = 0.2;
  double volume_weight = 0.01;       ///< loss weight of the mean volume of the Gaussians in view, cubic units
  double gradient_threshold = 2e-4;  ///< for the mean norm of a slot's screen gradient, NDC units
  /// An anchor is judged after being in view for this share of grow_interval, a slot after half of it.
  double success_threshold = 0.8;
  double min_opacity = 0.005;  ///< anchors with a lower mean sum of opacities are pruned
  double max_log_size = 0.05;  ///< upper limit of the log size bound of Gaussians, applied at every growth
  int statistics_from = 500;
  int grow_from = 1500;
  int grow_until = 15000;
  int grow_interval = 100;  ///< not scaled: the statistics need this many views
};

/// Calls visit(name, field) for every setting.
template <class Config, class Visit>
void for_each_anchor_field(Config& c, Visit&& visit) {
  visit("absolute_distances", c.absolute_distances);
  visit("feat_dim", c.feat_dim);
  visit("n_offsets", c.n_offsets);
  visit("appearance_dim", c.appearance_dim);
  visit("use_feat_bank", c.use_feat_bank);
  visit("add_opacity_dist", c.add_opacity_dist);
  visit("add_cov_dist", c.add_cov_dist);
  visit("add_color_dist", c.add_color_dist);
  visit("offset_rate_initial", c.offset_rate_initial);
  visit("offset_rate_final", c.offset_rate_final);
  visit("feature_rate", c.feature_rate);
  visit("scaling_rate", c.scaling_rate);
  visit("opacity_net_rate_initial", c.opacity_net_rate_initial);
  visit("opacity_net_rate_final", c.opacity_net_rate_final);
  visit("cov_net_rate_initial", c.cov_net_rate_initial);
  visit("cov_net_rate_final", c.cov_net_rate_final);
  visit("color_net_rate_initial", c.color_net_rate_initial);
  visit("color_net_rate_final", c.color_net_rate_final);
  visit("feat_bank_rate_initial", c.feat_bank_rate_initial);
  visit("feat_bank_rate_final", c.feat_bank_rate_final);
  visit("appearance_rate_initial", c.appearance_rate_initial);
  visit("appearance_rate_final", c.appearance_rate_final);
  visit("lambda_dssim", c.lambda_dssim);
  visit("volume_weight", c.volume_weight);
  visit("gradient_threshold", c.gradient_threshold);
  visit("success_threshold", c.success_threshold);
  visit("min_opacity", c.min_opacity);
  visit("max_log_size", c.max_log_size);
  visit("statistics_from", c.statistics_from);
  visit("grow_from", c.grow_from);
  visit("grow_until", c.grow_until);
  visit("grow_interval", c.grow_interval);
}

/// Throws InputError if a value is out of range. @param what prefix of the message, "config of backbone scaffold-gs: "
inline void check_anchor_config(const AnchorConfig& c, const std::string& what) {
  require(c.feat_dim >= 4 && c.feat_dim <= 256 && c.feat_dim % 4 == 0,
          what + "feat_dim must be a multiple of 4 from 4 to 256");
  require(c.n_offsets >= 1 && c.n_offsets <= 64, what + "n_offsets must be 1 to 64");
  require(c.appearance_dim >= 0 && c.appearance_dim <= 256, what + "appearance_dim must be 0 to 256");
  for (const double rate :
       {c.offset_rate_initial, c.offset_rate_final, c.feature_rate, c.scaling_rate, c.opacity_net_rate_initial,
        c.opacity_net_rate_final, c.cov_net_rate_initial, c.cov_net_rate_final, c.color_net_rate_initial,
        c.color_net_rate_final, c.feat_bank_rate_initial, c.feat_bank_rate_final, c.appearance_rate_initial,
        c.appearance_rate_final}) {
    require(rate > 0, what + "all learning rates must be above 0");
  }
  require(c.lambda_dssim >= 0 && c.lambda_dssim <= 1, what + "lambda_dssim must lie in [0, 1]");
  require(c.volume_weight >= 0, what + "volume_weight must not be negative");
  require(c.gradient_threshold > 0, what + "gradient_threshold must be above 0");
  require(c.success_threshold >= 0 && c.success_threshold <= 1, what + "success_threshold must lie in [0, 1]");
  require(c.min_opacity >= 0, what + "min_opacity must not be negative");
  require(c.statistics_from >= 0 && c.grow_from >= 0 && c.grow_until >= 0,
          what + "statistics_from, grow_from and grow_until must not be negative");
  require(c.grow_interval > 0, what + "grow_interval must be above 0");
}

}  // namespace splatboost
