// SPDX-License-Identifier: Apache-2.0
/// @file Reads any supported dataset: COLMAP (bin, txt), Blender / nerfstudio / instant-ngp transforms, captures of
/// Nerfies and HyperNeRF, rigs of videos, packed scenes.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "trainer/dataset/scene.h"

namespace splatboost {

struct SceneOptions {
  std::filesystem::path source;  ///< a folder, or a packed scene
  /// Image folder of a COLMAP scene or a Nerfies capture; none: "images" or "rgb/1x", or what was packed.
  std::optional<std::string> images;
  /// -1: full, but at most 1600 px wide (with a note); 1, 2, 4, 8: divisor; larger: width in px; none: -1, or as packed
  std::optional<int> resolution;
  bool eval = false;  ///< hold out test views: every llffhold-th by name, or a Blender test split
  int llffhold = 8;
  bool frame_times = false;   ///< of a COLMAP scene: the last number in an image's name tells its time
  std::optional<int> frames;  ///< of each camera of a rig of videos, from the beginning; 0: all; none: 24, or as packed
  std::filesystem::path test_list;  ///< file with one image name a line; instead of llffhold
  /// > 0: keep that many training views, evenly spread (sparse-view protocol), and start from the points of
  /// N_views/dense/fused.ply where there is this file
  int n_views = 0;
  bool white_background = false;
  int random_points = 100000;  ///< points to draw in the scene's box if the dataset has none
  std::uint64_t seed = 0;
};

/// Throws InputError (file and cause in one line) on anything wrong with the data, and on a packed scene whose pictures
/// are not those that the options ask for.
Scene read_scene(const SceneOptions& options);

/// Packs the dataset of a folder with all its views, so that read_scene() of `file` gives what it gives of the folder.
/// Of the options, `source`, `images`, `resolution`, `frames` and `frame_times` count. Throws InputError likewise.
/// @return what a user should know about how the data was read, a line each
std::vector<std::string> pack_scene(const SceneOptions& options, const std::filesystem::path& file);

}  // namespace splatboost
