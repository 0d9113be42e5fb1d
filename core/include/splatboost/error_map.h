// SPDX-License-Identifier: Apache-2.0
/// @file Which pixels of a view are badly reconstructed (paper eqs. 6-8).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "splatboost/device.h"
#include "splatboost/photometric.h"

namespace splatboost {

/// Flags pixels whose error, min-max normalised over the view's valid pixels, exceeds tau:
/// e(p) = mean over channels |render − truth|; flagged where (e − min) / (max − min + ε) > tau, ε = 1e-8.
/// A view of constant error has no flagged pixel; invalid pixels take no part and are never flagged.
/// @param render [3,H,W]
/// @param error [H,W] workspace, receives e(p)
/// @param flagged [H,W] receives 1 or 0
/// @return number of flagged pixels
std::size_t flag_errors(std::span<const float> render, const TruthImage& truth, float tau, std::span<float> error,
                        std::span<std::uint8_t> flagged, Device device);

}  // namespace splatboost
