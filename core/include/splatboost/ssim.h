// SPDX-License-Identifier: Apache-2.0
/// @file Structural similarity of float images (Wang et al. 2004), value and gradient, for callers with their own
/// loss. Trainers with 8-bit truth images use photometric.h, which needs one pass.
#pragma once

#include <cstddef>
#include <span>

#include "splatboost/device_array.h"
#include "splatboost/threads.h"

namespace splatboost {

/// Which windows the mean includes.
enum class SsimPadding {
  same,   ///< one around each pixel; pixels outside the image are zero
  valid,  ///< only windows within the image; width and height must exceed 10
};

/// Sizes of contiguous planes: the channels of a batch of images.
struct SsimPlanes {
  std::size_t count = 0;
  int width = 0;
  int height = 0;
};

/// Mean over planes and windows of SSIM (11×11 Gaussian window, σ 1.5; C1 = 0.01², C2 = 0.03²).
/// @param images,truths [count,H,W]
/// @param gradient [count,H,W] receives d mean / d images; empty: value only
double ssim(const SsimPlanes& planes, std::span<const float> images, std::span<const float> truths, SsimPadding padding,
            std::span<float> gradient, const Threads& threads);

/// Workspace of ssim() on a CUDA device; reuse it, so that a loop of steady sizes allocates nothing.
struct CudaSsimWorkspace {
  explicit CudaSsimWorkspace(CudaStream& stream) : derivatives(stream), sums(stream) {}
  DeviceArray<float> derivatives;  ///< [3,count,H,W] of SSIM by means, squares and products
  DeviceArray<double> sums;        ///< SSIM summed per tile
};

/// The same in the memory of a CUDA device; at most 65 535 planes. Does not wait.
/// @param mean [1] in device memory, receives the mean
void ssim(const SsimPlanes& planes, std::span<const float> images, std::span<const float> truths, SsimPadding padding,
          std::span<float> gradient, std::span<double> mean, CudaSsimWorkspace& workspace);

}  // namespace splatboost
