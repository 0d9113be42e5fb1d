// SPDX-License-Identifier: Apache-2.0
/// @file Pictures of the surface seen from a view.
#pragma once

#include <cstdint>
#include <vector>

#include "splatboost/threads.h"
#include "trainer/backbone_api/backbone.h"
#include "trainer/dataset/scene.h"

namespace splatboost::program {

struct SurfacePicture {
  std::vector<std::uint8_t> depth;    ///< [H,W] grey: nearer is brighter, 0 without a surface
  std::vector<std::uint8_t> normals;  ///< [H,W,3] from the depth: right, up and towards the camera as colours
};

/// @param backbone must have surfaces
SurfacePicture draw_surface(Backbone& backbone, const View& view, const Threads& threads);

}  // namespace splatboost::program
