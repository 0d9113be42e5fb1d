// SPDX-License-Identifier: Apache-2.0
/// @file A view of a ray-traced scene with its ground truth.
#pragma once

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "splatboost/threads.h"
#include "trainer/synth/synth_world.h"

namespace splatboost::synthetic {

inline constexpr double kFieldOfView = 66.0 * kPi / 180.0;  // horizontal
inline constexpr double kFarthestDepth = 65.5;              // metres; the range of 16-bit millimetres

/// Pixel centres are at (i + 0.5, j + 0.5).
struct Intrinsics {
  Intrinsics(int columns, int rows)
      : width(columns),
        height(rows),
        focal(0.5 * columns / std::tan(0.5 * kFieldOfView)),
        cx(0.5 * columns),
        cy(0.5 * rows) {}
  int width, height;
  double focal, cx, cy;

  Ray ray(const Pose& pose, double x, double y) const {
    return {pose.centre, glm::normalize(pose.world_from_camera * Vec3((x - cx) / focal, (y - cy) / focal, 1.0))};
  }
};

struct Picture {
  explicit Picture(const Intrinsics& camera) {
    const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
    color.resize(3 * pixels);
    depth.resize(pixels);
    normals.resize(3 * pixels);
    mask.resize(pixels);
  }
  std::vector<std::uint8_t> color;    ///< [H,W,3] sRGB
  std::vector<double> depth;          ///< [H,W] z in metres, 0 in the sky
  std::vector<std::uint8_t> normals;  ///< [H,W,3] world frame, 127.5·(n + 1)
  std::vector<std::uint8_t> mask;     ///< [H,W] 255 for objects, else 0
};

/// Renders a view and its ground truth. @param samples of colour per pixel and axis
void render_view(const World& world, const Intrinsics& camera, const Pose& pose, int samples, const Threads& threads,
                 Picture& picture);

/// Creates a folder for write_picture(), and removes temporary files that killed processes left in it.
void make_picture_folder(const std::filesystem::path& folder);

/// Writes output/colors/name, output/depth/name (16 bit, mm, 0 beyond 65 m), output/normals/name and output/masks/name.
void write_picture(const std::filesystem::path& output, const std::string& colors, const std::string& name,
                   const Intrinsics& camera, const Picture& picture);

}  // namespace splatboost::synthetic
