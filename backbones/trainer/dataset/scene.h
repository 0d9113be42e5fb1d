// SPDX-License-Identifier: Apache-2.0
/// @file A scene in memory: undistorted pinhole views with 8-bit truth, and the points to start from.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "splatboost/camera.h"
#include "splatboost/photometric.h"

namespace splatboost {

/// One photo with its camera. Pixels are planar [3,H,W]; transparent images are already composited.
struct View {
  std::string name;  ///< path below the image folder, as the dataset spells it
  Camera camera;
  std::vector<std::uint8_t> color;  ///< [3,H,W]
  std::vector<std::uint8_t> valid;  ///< [H,W] non-zero where the photo has data; empty: everywhere
  float time = 0;                   ///< [0,1] for dynamic scenes
  TruthImage truth() const { return {camera.width, camera.height, color, valid}; }
};

/// Points to start from.
struct PointCloud {
  std::vector<float> positions;      ///< [N,3] world
  std::vector<std::uint8_t> colors;  ///< [N,3]
  std::size_t size() const { return positions.size() / 3; }
};

struct Scene {
  std::vector<View> train;
  std::vector<View> test;
  /// The training views at half their size, in the same order, for the coarse start of a run; empty: it has none.
  std::vector<View> train_halves;
  PointCloud points;
  float extent = 0;  ///< 1.1 × largest distance of a training camera from their mean (3DGS)
  bool white_background = false;
  bool synthetic = false;  ///< pictures were computed (NeRF-synthetic, D-NeRF): exact poses, an empty background
  std::vector<std::string> notes;  ///< what a user should know about how the data was read, a line each
};

/// 3DGS's scene extent of these views.
float camera_extent(const std::vector<View>& views);

}  // namespace splatboost
