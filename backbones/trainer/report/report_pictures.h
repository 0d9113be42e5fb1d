// SPDX-License-Identifier: Apache-2.0
/// @file Pictures embedded in a report. In a build without OpenCV they are empty (have_opencv()).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace splatboost {

/// Factor on errors before the colour map: errors above 1 / gain of the range are all shown as "very wrong".
inline constexpr double kReportErrorGain = 4;

struct ReportPicture {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> jpeg;  ///< empty: no picture
};

/// Reads a picture and shrinks it for the page.
ReportPicture report_picture(const std::filesystem::path& path);

/// Reads a grey picture, shrinks it and applies the colour map of the errors.
ReportPicture report_depth_picture(const std::filesystem::path& path);

/// Mean over channels of |render − truth|, colour mapped; empty if the two cannot be compared.
ReportPicture report_error_picture(const std::filesystem::path& render, const std::filesystem::path& truth);

/// The colour map, from no error to "very wrong", as the stops of a CSS gradient.
std::string report_error_colors();

}  // namespace splatboost
