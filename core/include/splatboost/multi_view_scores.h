// SPDX-License-Identifier: Apache-2.0
/// @file Scores a backbone's primitives over K of its views, with one render and one replay per view.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "splatboost/device.h"
#include "splatboost/device_array.h"
#include "splatboost/error_map.h"
#include "splatboost/hooks.h"
#include "splatboost/random.h"
#include "splatboost/scores.h"

namespace splatboost {

struct MultiViewOptions {
  int views = 10;             ///< K; min(K, scorable views) are drawn without replacement
  float tau = 0.1f;           ///< error threshold of paper eq. 8
  float lambda_dssim = 0.2f;  ///< λ of the view loss E_j, paper eq. 10
  bool losses = true;         ///< compute E_j; if false, weighted_counts stays empty and only importance is available
};

/// Draws random views, renders each, flags its errors and counts. Owns the workspace.
/// Each view is rendered once: the counts replay the tile lists of the render that gave the errors.
class MultiViewScorer {
 public:
  explicit MultiViewScorer(Device device);
  /// On a CUDA device the hook's views, masks and counts are in device memory. Waits for the device.
  /// @return the sums, in host memory; valid until the next call
  const ScoreSums& score(RasterizerHook& rasterizer, const MultiViewOptions& options, const RandomStream& random);
  /// Mean number of pixels of the views scored last.
  double mean_pixels() const { return mean_pixels_; }
  /// Share of the valid pixels of the views scored last that show the scene: those with an error above kNoError
  /// (error_map.h). Nearly 1 for photos; small for an object in front of an empty background, which is matched exactly.
  double covered_share() const { return covered_share_; }

 private:
  struct OnCuda {
    DeviceArray<float> error;
    DeviceArray<std::uint8_t> flagged;
    DeviceArray<std::int32_t> view_counts;
    DeviceArray<std::int64_t> counts;
    DeviceArray<double> weighted_counts;
  };
  /// E_j, or 0 if options.losses is false.
  double loss_of(const ScoredView& view, const MultiViewOptions& options);
  void note(const ErrorCounts& found, double loss);
  void score_view(RasterizerHook& rasterizer, const ScoredView& view, const MultiViewOptions& options);
  void score_view_on_cuda(RasterizerHook& rasterizer, const ScoredView& view, const MultiViewOptions& options);

  Device device_;
  Photometric photometric_;
  ScoreSums sums_;
  std::vector<float> error_;
  std::vector<std::uint8_t> flagged_;
  std::vector<std::int32_t> counts_;
  std::optional<OnCuda> cuda_;
  double valid_pixels_ = 0;
  double covered_pixels_ = 0;
  double mean_pixels_ = 0;
  double covered_share_ = 1;
};

/// Draws min(k, n) of the views 0 .. n-1 without replacement, in the order drawn.
std::vector<std::size_t> draw_views(std::size_t n, int k, const RandomStream& random);

}  // namespace splatboost
