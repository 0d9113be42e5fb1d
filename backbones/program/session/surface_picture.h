// SPDX-License-Identifier: Apache-2.0
/// @file The surface that a view shows, as pictures.
#pragma once

#include <cstdint>
#include <vector>

#include "splatboost/threads.h"
#include "trainer/backbone_api/backbone.h"
#include "trainer/dataset/scene.h"

namespace splatboost::program {

struct SurfacePicture {
  std::vector<std::uint8_t> depth;    ///< [H,W] grey: nearer is brighter, 0 where nothing is there
  std::vector<std::uint8_t> normals;  ///< [H,W,3] of the depth: right, up and towards the camera as colours
};

/// @param backbone one that has surfaces
SurfacePicture draw_surface(Backbone& backbone, const View& view, Threads& threads);

}  // namespace splatboost::program
