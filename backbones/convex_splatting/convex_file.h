// SPDX-License-Identifier: Apache-2.0
/// @file Model files of convexes, see docs/formats.md.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

namespace splatboost {

/// Raw (not activated) parameters.
struct ConvexCloud {
  std::vector<float> points;           ///< [N,6,3]
  std::vector<float> log_smoothness;   ///< [N]
  std::vector<float> log_sharpness;    ///< [N]
  std::vector<float> logit_opacities;  ///< [N]
  std::vector<float> logit_masks;      ///< [N]
  std::vector<float> sh_dc;            ///< [N,3]
  std::vector<float> sh_rest;          ///< [N,15,3]
  /// Focal lengths of the reference images, px, ascending; smoothness and sharpness are in pixels of one of these.
  std::vector<float> focal_lengths;
  std::size_t size() const { return logit_opacities.size(); }
};

/// Writes point_cloud.ply and convexes.bin. @return bytes written. Throws std::runtime_error, and writes nothing, if a
/// value is not finite.
std::uint64_t write_convexes(const std::filesystem::path& folder, const ConvexCloud& cloud);
/// Throws InputError if anything is missing or truncated.
ConvexCloud read_convexes(const std::filesystem::path& folder);

}  // namespace splatboost
