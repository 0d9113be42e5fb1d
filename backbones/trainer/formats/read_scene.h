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
  /// Image folder of a COLMAP scene or a Nerfies capture; unset: "images" or "rgb/1x", or as packed.
  std::optional<std::string> images;
  /// -1: full, but at most 1600 px wide (with a note); 1, 2, 4, 8: divisor; larger: px width; unset: -1, or as packed
  std::optional<int> resolution;
  /// Divides the size that `resolution` gives, rounded down. Below 1 it throws InputError if a photo is too small.
  double photo_scale = 1;
  bool eval = false;  ///< hold out test views: the dataset's own test split, or every llffhold-th by name
  int llffhold = 8;
  bool frame_times = false;   ///< COLMAP scenes: times from the last number in each image name
  std::optional<int> frames;  ///< rigs of videos: first frames of each camera to read; 0: all; unset: 24, or as packed
  /// File with one image name per line; replaces other test splits. Images of the dataset's own test split that it does
  /// not list are neither trained on nor tested.
  std::filesystem::path test_list;
  /// > 0: number of training views to keep, evenly spread (sparse-view protocol); training then starts from the points
  /// of N_views/dense/fused.ply if that file exists
  int n_views = 0;
  bool white_background = false;
  bool points = true;          ///< false: only the views are wanted; Scene::points stays empty
  int random_points = 100000;  ///< to sample in the scene's box if the dataset has no points and its photos give few
  std::uint64_t seed = 0;
};

/// If the dataset has no points, or all at one place, they are triangulated from the training photos; if that gives
/// few, and for rendered scenes as in 3DGS, they are drawn at random. Throws InputError (file and cause in one line) if
/// the data is invalid, or if the options ask for other images than those in a packed scene. Scene::notes names options
/// that have no effect on the dataset.
Scene read_scene(const SceneOptions& options);

/// Packs the dataset of a folder with all its views; read_scene() then gives the same result for `file` as for the
/// folder. Only `source`, `images`, `resolution`, `frames` and `frame_times` are used. Throws InputError likewise.
/// @return notes for the user on how the data was read, one line each
std::vector<std::string> pack_scene(const SceneOptions& options, const std::filesystem::path& file);

}  // namespace splatboost
