// SPDX-License-Identifier: Apache-2.0
/// @file Structural similarity of float images (Wang et al. 2004), value and gradient, for hosts with a loss of their
/// own. Trainers that keep 8-bit truths take photometric.h, which is one pass.
#pragma once

#include <cstddef>
#include <span>

#include "splatboost/threads.h"

namespace splatboost {

/// Which windows the mean is over.
enum class SsimPadding {
  same,   ///< one around each pixel; outside the image reads as zero
  valid,  ///< those that lie within the image; width and height must be above 10
};

/// Planes, one after the other: channels of images.
struct SsimPlanes {
  std::size_t count = 0;
  int width = 0;
  int height = 0;
};

/// Mean over planes and windows of SSIM (11×11 Gaussian window, σ 1.5; C1 = 0.01², C2 = 0.03²).
/// @param images,truths [count,H,W]
/// @param gradient [count,H,W] receives d mean / d images; empty: value only
double ssim(const SsimPlanes& planes, std::span<const float> images, std::span<const float> truths, SsimPadding padding,
            std::span<float> gradient, Threads& threads);

}  // namespace splatboost
