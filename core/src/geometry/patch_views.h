// SPDX-License-Identifier: Apache-2.0
/// @file Parameters of two views for the comparison of patches of their photos (patch_math.h), and that of a row of
/// patches on the CPU.
#pragma once

#include <cstdint>
#include <span>

#include "geometry/surface_math.h"
#include "geometry/surface_workspace.h"

namespace splatboost {

inline constexpr int kPatchRadius = 3;
inline constexpr int kPatchSide = 2 * kPatchRadius + 1;
inline constexpr int kPatchPixels = kPatchSide * kPatchSide;
inline constexpr float kMaxPatchLoss = 0.9f;    ///< patches that differ more are occluded
inline constexpr float kMinPatchDepth = 1e-8f;  ///< of the plane and of its points in the second view

struct PatchViews {
  float cx_first, cy_first, step_x, step_y;  ///< step: from pixel to pixel along x and y, at a depth of 1
  float fx_second, fy_second, cx_second, cy_second;
  float rotation[3][3], shift[3];  ///< second_from_first
  int width_first, height_first, width_second, height_second;
  int width, height;   ///< of the render of the first view
  float per_x, per_y;  ///< pixels of the first photo per pixel of that render
};

/// The photo in which patches of the view are compared.
inline PatchPhoto patch_photo(const SurfaceView& view) {
  return view.patches != nullptr ? *view.patches : PatchPhoto{view.camera, view.truth};
}

/// @param photos cameras of the two photos
/// @param width,height of the render of the first view
inline PatchViews patch_views(const surface::ViewPair<float>& photos, int width, int height) {
  const surface::Pinhole<float>&a = photos.first, &b = photos.second;
  const surface::Motion<float>& motion = photos.second_from_first;
  PatchViews views{.cx_first = a.cx,
                   .cy_first = a.cy,
                   .step_x = 1 / a.fx,
                   .step_y = 1 / a.fy,
                   .fx_second = b.fx,
                   .fy_second = b.fy,
                   .cx_second = b.cx,
                   .cy_second = b.cy,
                   .rotation = {},
                   .shift = {},
                   .width_first = a.width,
                   .height_first = a.height,
                   .width_second = b.width,
                   .height_second = b.height,
                   .width = width,
                   .height = height,
                   .per_x = static_cast<float>(a.width) / static_cast<float>(width),
                   .per_y = static_cast<float>(a.height) / static_cast<float>(height)};
  for (int k = 0; k < 3; ++k) {
    views.rotation[k][0] = motion.rows[k].x;
    views.rotation[k][1] = motion.rows[k].y;
    views.rotation[k][2] = motion.rows[k].z;
  }
  views.shift[0] = motion.shift.x;
  views.shift[1] = motion.shift.y;
  views.shift[2] = motion.shift.z;
  return views;
}

/// Column or row of the pixel of the first photo at the centre of a pixel of the render.
/// @param place column or row of that pixel
/// @param per PatchViews::per_x or per_y
SPLATBOOST_HOST_DEVICE float place_in_photo(int place, float per) {
  return static_cast<float>(static_cast<int>((static_cast<float>(place) + 0.5f) * per));
}

/// Compares patches around pixels of a row of the first view.
/// @param columns the pixels
/// @param planes [4,H,W] of the first view
/// @param greys_first, greys_second [H,W] of the photos; NaN where masked
/// @param losses,counts,gradients one per element of columns; count 1 where the patch counts, otherwise all are 0
void match_patches(const PatchViews& views, int row, std::span<const std::int32_t> columns,
                   std::span<const float> planes, std::span<const float> greys_first,
                   std::span<const float> greys_second, std::span<float> losses, std::span<float> counts,
                   std::span<PatchGradient> gradients);

}  // namespace splatboost
