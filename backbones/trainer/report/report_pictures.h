// SPDX-License-Identifier: Apache-2.0
/// @file Pictures as a report embeds them. A build without OpenCV makes none: have_opencv() says so.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace splatboost {

/// Errors above the inverse of this share of the range are all "very wrong".
inline constexpr double kReportErrorGain = 4;

struct ReportPicture {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> jpeg;  ///< empty: there is no picture
};

/// A picture from disk, shrunk to what a page needs.
ReportPicture report_picture(const std::filesystem::path& path);

/// Grey values from disk through the same colour map as errors, shrunk.
ReportPicture report_depth_picture(const std::filesystem::path& path);

/// Mean over channels of |render − truth| through the colour map; empty where the two cannot be compared.
ReportPicture report_error_picture(const std::filesystem::path& render, const std::filesystem::path& truth);

/// The colour map, from no error to "very wrong", as the stops of a CSS gradient.
std::string report_error_colors();

}  // namespace splatboost
