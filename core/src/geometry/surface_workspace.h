// SPDX-License-Identifier: Apache-2.0
/// @file Workspace of SurfaceLoss.
#pragma once

#include <cstddef>

#include "splatboost/array.h"
#include "splatboost/surface_loss.h"

namespace splatboost {

/// Match of a pixel of the first view in the second.
struct PixelMatch {
  float noise;     ///< px; below 0: no match
  float x, y;      ///< position in the second view, px
  float g_first;   ///< ∂ noise / ∂ depth of the first view
  float g_second;  ///< ∂ noise / ∂ depth of the second view at (x, y)
};
/// Gradient of a patch around such a pixel.
struct PatchGradient {
  float normal[3], distance;  ///< of v·c with respect to the blended plane
};

/// Indices of the sums of a call.
enum SurfaceSum : std::size_t {
  kNormalSum,   ///< Σ w·‖n_d − n‖₁
  kNoiseSum,    ///< Σ v·ε
  kNoiseCount,  ///< pixels that agree
  kPatchSum,    ///< Σ v·c
  kPatchCount,  ///< patches that count
  kSurfaceSums,
};

struct SurfaceWorkspace {
  explicit SurfaceWorkspace(Device device)
      : depth{Array<float>(device), Array<float>(device)},
        depth_gradients{Array<float>(device), Array<float>(device)},
        edges(device),
        edge_range(device),
        differences(device),
        greys{Array<float>(device), Array<float>(device)},
        matches(device),
        patches(device),
        sums(device) {}

  Array<float> depth[2];            ///< [H,W] of the views
  Array<float> depth_gradients[2];  ///< [H,W]
  Array<float> edges;               ///< [H,W]
  Array<std::uint32_t> edge_range;  ///< only on a GPU: ~bits of the least edge, bits of the greatest
  Array<float> differences;         ///< [6,H,W] gradients of the two differences that a pixel's normal is made of
  Array<float> greys[2];            ///< [H,W] of the photos in which patches are compared
  Array<PixelMatch> matches;        ///< [H,W] of the first view
  Array<PatchGradient> patches;     ///< [H,W]
  Array<double> sums;               ///< [kSurfaceSums]
};

/// Of all arrays of a SurfaceWorkspace with one element or more per pixel.
inline constexpr std::size_t kSurfaceBytesPerPixel =
    (2 + 2 + 1 + 6 + 2) * sizeof(float) + sizeof(PixelMatch) + sizeof(PatchGradient);

/// The terms of the loss, given the sums. @param sums [kSurfaceSums] @param pixels of the first view
inline SurfaceLossParts surface_loss_parts(const double* sums, const SurfaceTerms& terms, std::size_t pixels) {
  const auto mean = [](double sum, double count) { return count > 0 ? sum / count : 0.0; };
  return {static_cast<double>(terms.normal_weight) * mean(sums[kNormalSum], static_cast<double>(pixels)),
          static_cast<double>(terms.geometric_weight) * mean(sums[kNoiseSum], sums[kNoiseCount]),
          static_cast<double>(terms.photometric_weight) * mean(sums[kPatchSum], sums[kPatchCount])};
}

}  // namespace splatboost
