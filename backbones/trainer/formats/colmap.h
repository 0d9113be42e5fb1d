// SPDX-License-Identifier: Apache-2.0
/// @file COLMAP's sparse models: cameras, images, points3D as .bin or .txt.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "trainer/dataset/view_image.h"

namespace splatboost {

struct ColmapCamera {
  std::uint32_t id = 0;
  int model = 1;  ///< COLMAP's model ID; 1 is PINHOLE
  std::uint64_t width = 0;
  std::uint64_t height = 0;
  std::vector<double> params;  ///< in COLMAP's order for the model
};

struct ColmapImage {
  std::uint32_t id = 0;
  double rotation[4] = {1, 0, 0, 0};  ///< camera from world, quaternion w, x, y, z
  double translation[3] = {0, 0, 0};
  std::uint32_t camera_id = 0;
  std::string name;
};

struct ColmapModel {
  std::vector<ColmapCamera> cameras;
  std::vector<ColmapImage> images;
  PointCloud points;                   ///< empty if the model has none
  std::filesystem::path cameras_file;  ///< the files it was read from
  std::filesystem::path images_file;
  std::filesystem::path points_file;  ///< empty if the model has no points
};

enum class ColmapFormat { binary, text };

/// source/sparse/0 or source/sparse, whichever holds a model.
std::optional<std::filesystem::path> find_colmap_model(const std::filesystem::path& source);

/// The folder beside that of a model, as sparse/1 beside sparse/0, with a model of more images: COLMAP writes several
/// if it cannot connect all images, and the first is not always the largest. None if there is no such folder.
/// @param images of the model
std::optional<std::filesystem::path> find_larger_model(const std::filesystem::path& folder, std::size_t images);

/// Reads a model; .bin is preferred, points may also be a points3D.ply. Throws InputError on a file that is missing,
/// cut short or of an unknown camera model.
ColmapModel read_colmap_model(const std::filesystem::path& folder);

/// Writes a model without tracks (the *_file members are not used). The folder must exist.
void write_colmap_model(const std::filesystem::path& folder, const ColmapModel& model,
                        ColmapFormat format = ColmapFormat::binary);

/// The photos of a model, sorted by name. Throws InputError on a pose, or a camera of a photo, that cannot be used.
std::vector<Photo> colmap_photos(const ColmapModel& model, const std::filesystem::path& image_folder);

}  // namespace splatboost
