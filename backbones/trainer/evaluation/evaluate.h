// SPDX-License-Identifier: Apache-2.0
/// @file Measures how well a backbone renders the test views of a scene.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "trainer/backbone_api/backbone.h"
#include "trainer/dataset/scene.h"
#include "trainer/evaluation/metrics.h"
#include "trainer/evaluation/results.h"

namespace splatboost {

/// The views that renders are measured on: the test views, or the training views if there are none.
const std::vector<View>& measured_views(const Scene& scene);

/// Renders the measured views as trained, writes them to `renders`/<picture_names>.png (not written if `renders` is
/// empty), measures them, and fills the quality part of `results` (psnr, ssim, lpips, psnr_beta1, split, views, scales,
/// fps). Lpips may be null. Scales at which a view would be smaller than SSIM's window are left out.
void evaluate(Backbone& backbone, const Scene& scene, Lpips* lpips, const std::filesystem::path& renders,
              Results& results);

/// The measurements of one view.
struct MeasuredView {
  ViewResult result;
  double psnr_beta1 = 0;
  double render_seconds = 0;
};

/// Renders one view as trained into `color` ([3,H,W], clamped to [0,1]) and measures it. Lpips may be null.
MeasuredView measure_view(Backbone& backbone, const View& view, Lpips* lpips, std::vector<float>& color);

/// Mean PSNR of up to `count` measured views, evenly spread, rendered as trained.
double quick_psnr(Backbone& backbone, const Scene& scene, int count);

/// File name stem of each view's pictures: the stem of the view's name or, if several views share it, the whole name
/// with '_' for '/'. Names too long for a file system are cut. If this leaves equal names, later ones get "_2", "_3", …
std::vector<std::string> picture_names(const std::vector<View>& views);

/// Saves a planar [3,H,W] image as PNG; floats are clamped to [0,1]. Atomic.
void write_png(const std::filesystem::path& path, std::span<const float> color, int width, int height);
void write_png(const std::filesystem::path& path, std::span<const std::uint8_t> color, int width, int height);

}  // namespace splatboost
