// SPDX-License-Identifier: Apache-2.0
/// @file Which pixels of a view are badly reconstructed (paper eqs. 6-8).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "splatboost/device.h"
#include "splatboost/photometric.h"

namespace splatboost {

/// Errors up to this mark a pixel that shows only an exactly matched background, with a margin for rounding. Photos
/// have almost no such pixels.
inline constexpr float kNoError = 1e-4f;

/// Numbers of pixels of a view.
struct ErrorCounts {
  std::size_t flagged = 0;
  std::size_t valid = 0;
  std::size_t covered = 0;  ///< valid, with an error above kNoError
};

/// Flags pixels whose error, min-max normalised over the view's valid pixels, exceeds tau:
/// e(p) = mean over channels |render − truth|; flagged where (e − min) / (max − min + ε) > tau, ε = 1e-8.
/// A view of constant error has no flagged pixel; invalid pixels take no part and are never flagged. Waits on a GPU.
/// @param render [3,H,W]
/// @param tau in [0, 1]
/// @param error [H,W] workspace, receives e(p)
/// @param flagged [H,W] receives 1 or 0
ErrorCounts flag_errors(std::span<const float> render, const TruthImage& truth, float tau, std::span<float> error,
                        std::span<std::uint8_t> flagged, Device device);

}  // namespace splatboost
