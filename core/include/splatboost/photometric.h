// SPDX-License-Identifier: Apache-2.0
/// @file The photometric loss (1−λ)·L1 + λ·(1−SSIM) (paper eq. 10), value and gradient in one pass over strips.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "splatboost/device.h"

namespace splatboost {

/// A ground-truth image: 8 bit, planar, a view of the caller's memory.
struct TruthImage {
  int width = 0;
  int height = 0;
  std::span<const std::uint8_t> color;  ///< [3,H,W], 255 = 1.0
  std::span<const std::uint8_t> valid;  ///< [H,W] non-zero where the pixel counts; empty: all do
};

struct PhotometricLoss {
  double l1 = 0;    ///< mean |render − truth| over valid pixels and channels
  double ssim = 0;  ///< mean SSIM over valid pixels and channels (11×11 Gaussian, σ 1.5, zero padding)
  double total = 0;
};

/// Owns the workspace of the loss; a steady loop allocates nothing. The order of summation is fixed.
class Photometric {
 public:
  explicit Photometric(Device device);
  ~Photometric();
  Photometric(Photometric&&) noexcept;
  Photometric& operator=(Photometric&&) noexcept;

  /// Invalid pixels are excluded from the means; in SSIM windows they are replaced by the truth, so they add no error.
  /// Waits on a GPU, and returns the loss of this call; but if an earlier evaluate_ahead() computed one that is not
  /// finite and was not returned yet, returns that one.
  /// @param render [3,H,W]
  /// @param gradient [3,H,W] receives d total / d render; empty: value only
  PhotometricLoss evaluate(std::span<const float> render, const TruthImage& truth, float lambda_dssim,
                           std::span<float> gradient);

  /// The same for training loops: on a GPU it does not wait for its own loss, but returns the newest that has arrived
  /// from an earlier call (the first call waits). After a loss that is not finite it keeps returning that one until
  /// evaluate() has returned it, so that none is missed.
  PhotometricLoss evaluate_ahead(std::span<const float> render, const TruthImage& truth, float lambda_dssim,
                                 std::span<float> gradient);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost
