// SPDX-License-Identifier: Apache-2.0
/// @file A scene in memory: undistorted pinhole views with 8-bit ground truth, and the initial points.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "splatboost/camera.h"
#include "splatboost/photometric.h"

namespace splatboost {

/// One photo with its camera. Pixels are planar [3,H,W]; transparent images are already composited.
struct View {
  std::string name;  ///< path relative to the image folder, as written in the dataset
  Camera camera;
  std::vector<std::uint8_t> color;  ///< [3,H,W]
  std::vector<std::uint8_t> valid;  ///< [H,W] non-zero where the photo has data that its mask allows; empty: everywhere
  float time = 0;                   ///< [0,1] for dynamic scenes
  TruthImage truth() const { return {camera.width, camera.height, color, valid}; }
};

/// Points that the Gaussians are initialised from.
struct PointCloud {
  std::vector<float> positions;      ///< [N,3] world
  std::vector<std::uint8_t> colors;  ///< [N,3]
  std::size_t size() const { return positions.size() / 3; }
};

struct Scene {
  std::vector<View> train;
  std::vector<View> test;
  /// The training views at half their size, in the same order, for the coarse start of a run; empty if there are none.
  std::vector<View> train_halves;
  /// The training photos at Backbone::photo_scale(), in the same order; empty if that is 1.
  std::vector<View> train_rescaled;
  PointCloud points;
  std::filesystem::path points_file;  ///< that `points` were read from; empty if there is none
  bool lacks_points = false;  ///< the dataset has none: `points` were triangulated from the photos, or are random
  /// For a run that starts from more points, in addition to `points`: triangulated from the training photos.
  PointCloud more_points;
  float extent = 0;  ///< 1.1 × largest distance of a training camera from their mean (3DGS)
  bool white_background = false;
  bool cut_out = false;    ///< photos have transparent pixels, which got the colour of the background, white or black
  bool synthetic = false;  ///< images were rendered (NeRF-synthetic, D-NeRF): exact poses, an empty background
  /// Notes for the user on how the data was read, one line each.
  std::vector<std::string> notes;
};

/// `points` and `more_points`.
PointCloud starting_points(const Scene& scene);

/// Whether the training views have different times.
bool moves(const Scene& scene);

/// Scene extent of these views as in 3DGS; 0 if there are none, or if their positions differ by rounding only.
float camera_extent(const std::vector<View>& views);

}  // namespace splatboost
