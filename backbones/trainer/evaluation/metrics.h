// SPDX-License-Identifier: Apache-2.0
/// @file Image quality metrics of the usual protocols. Renders are [3,H,W] and are clamped to [0,1].
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <span>

#include "splatboost/photometric.h"

namespace splatboost {

/// 10·log10(1 / MSE) over valid pixels and channels; 100 if the images are equal.
double psnr(std::span<const float> render, const TruthImage& truth);

/// Mean SSIM, 11×11 Gaussian window of σ 1.5, zero padding, over valid pixels and channels (3DGS's protocol).
double ssim(std::span<const float> render, const TruthImage& truth);

/// Learned perceptual similarity (LPIPS v0.1, SqueezeNet), computed with OpenCV's DNN module.
class Lpips {
 public:
  static constexpr int kSmallest = 32;  ///< pixels in each direction; of less, the network's four strides leave nothing

  /// @param onnx file made by scripts/lpips_to_onnx. Throws InputError if it cannot be read.
  explicit Lpips(const std::filesystem::path& onnx);
  ~Lpips();
  /// Throws InputError if the images are smaller than kSmallest.
  double distance(std::span<const float> render, const TruthImage& truth);
  /// Frees the feature maps of the last images, which the network keeps.
  void release_memory();

 private:
  struct Network;
  std::unique_ptr<Network> network_;
};

}  // namespace splatboost
