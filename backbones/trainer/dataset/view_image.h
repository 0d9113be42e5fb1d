// SPDX-License-Identifier: Apache-2.0
/// @file From a photo on disk to a view in memory: decoded, composited, undistorted, resized.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <glm/mat4x4.hpp>

#include "trainer/dataset/scene.h"

namespace splatboost {

struct Pixels;

/// Camera of a photo: a pinhole with polynomial distortion (Brown-Conrady, as COLMAP and OpenCV define it).
/// In pixels of an image of width × height; the photo on disk may be a uniformly scaled version of that.
struct Lens {
  int width = 0;  ///< 0: the photo's own
  int height = 0;
  double fx = 0;       ///< 0: from angle_x, or else equal to fy
  double fy = 0;       ///< 0: from angle_y if fx is not given and there is one, else equal to fx
  double angle_x = 0;  ///< full field of view in radians; 0: not known
  double angle_y = 0;
  std::optional<double> cx;  ///< unset: the image centre
  std::optional<double> cy;
  double k1 = 0, k2 = 0, k3 = 0;  ///< radial
  double p1 = 0, p2 = 0;          ///< tangential

  bool distorted() const { return k1 != 0 || k2 != 0 || k3 != 0 || p1 != 0 || p2 != 0; }
};

/// A photo that a dataset lists, not yet read.
struct Photo {
  std::string name;  ///< View::name
  std::filesystem::path file;
  std::filesystem::path mask_file;  ///< of the photo's size, black where it is not to be used; empty: none
  std::filesystem::path listed_in;  ///< the file that lists it, for error messages
  Lens lens;
  glm::dmat4 camera_from_world{1.0};
  double time = 0;
  int video_frame = -1;  ///< index of the frame if `file` is a video, else -1
};

struct ImageOptions {
  int resolution = -1;     ///< as SceneOptions::resolution
  double photo_scale = 1;  ///< as SceneOptions::photo_scale
  bool white_background = false;
};

/// Throws InputError, beginning with `where`, if the lens cannot be used.
void check_lens(const Lens& lens, const std::string& where);

struct ImageSize {
  int width = 0;
  int height = 0;
  bool operator==(const ImageSize&) const = default;
};

/// The size that a photo of width × height is reduced to. @param resolution as SceneOptions::resolution
ImageSize target_size(int width, int height, int resolution);

/// Throws InputError unless the resolution is one that SceneOptions allows.
void check_resolution(int resolution);

struct LoadedView {
  View view;
  ImageSize photo_size;      ///< before the resize
  bool transparent = false;  ///< has pixels that are not opaque
  bool limited = false;      ///< reduced to the limit of 1600 px that resolution = -1 sets
  bool undistorted = false;
};

/// Reads one photo. Alpha is straight and composited over white or black; 16 bit becomes 8 bit, grey becomes RGB;
/// a distorted photo is resampled to the pinhole of the same focal lengths and principal point, and pixels without
/// data or with a black mask are not valid; downsampling averages areas. Throws InputError in one line.
LoadedView load_view(const Photo& photo, const ImageOptions& options);
/// Same, for pixels that are already decoded.
LoadedView load_view(const Photo& photo, const ImageOptions& options, Pixels stored);

/// An image file decoded without conversion: interleaved [H,W,channels], channels in the order R, G, B, A.
struct RawImage {
  int width = 0;
  int height = 0;
  int channels = 0;
  int bits = 8;  ///< 8 or 16
  std::vector<std::uint16_t> values;
  std::uint16_t at(int x, int y, int channel = 0) const {
    const std::size_t pixel =
        static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
    return values[pixel * static_cast<std::size_t>(channels) + static_cast<std::size_t>(channel)];
  }
};

/// Reads depth maps, normals, masks: nothing is converted. Throws InputError in one line.
RawImage read_raw_image(const std::filesystem::path& file);

/// Atomically writes a PNG of interleaved pixels, 1 (grey), 3 (RGB) or 4 (RGBA) channels.
void write_png(const std::filesystem::path& path, int width, int height, int channels,
               std::span<const std::uint8_t> pixels);
void write_png(const std::filesystem::path& path, int width, int height, int channels,
               std::span<const std::uint16_t> pixels);

}  // namespace splatboost
