// SPDX-License-Identifier: Apache-2.0
/// @file The photometric loss, by brute force in double precision.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace splatboost::reference {

/// [3,H,W] images; valid [H,W] or empty (all valid).
struct ImagePair {
  int width = 0;
  int height = 0;
  std::vector<double> render;
  std::vector<double> truth;
  std::vector<std::uint8_t> valid;
};

struct Loss {
  double l1 = 0;
  double ssim = 0;
  double total = 0;  ///< (1−λ)·l1 + λ·(1−ssim)
};

/// L1 and SSIM (11×11 Gaussian window with σ 1.5, zero padding, means over valid pixels and channels).
/// Within the windows, the render's invalid pixels are replaced by the truth.
Loss photometric(const ImagePair& images, double lambda);

/// d total / d render at the given elements (empty: all), computed with dual numbers.
std::vector<double> photometric_gradient(const ImagePair& images, double lambda,
                                         const std::vector<std::size_t>& elements = {});

/// Error map and its flags (paper eqs. 6-8), in double precision.
struct ErrorMap {
  std::vector<double> error;       ///< [H,W] mean over channels of |render − truth|
  std::vector<double> normalized;  ///< [H,W] (e − min)/(max − min + 1e-8) over valid pixels; 0 where invalid
};
ErrorMap error_map(const ImagePair& images);

}  // namespace splatboost::reference
