// SPDX-License-Identifier: Apache-2.0
// Replaces report_pictures.cpp in a build without OpenCV.
#include "trainer/report/report_pictures.h"

namespace splatboost {

ReportPicture report_picture(const std::filesystem::path&) { return {}; }
ReportPicture report_depth_picture(const std::filesystem::path&) { return {}; }
ReportPicture report_error_picture(const std::filesystem::path&, const std::filesystem::path&) { return {}; }
std::string report_error_colors() { return ""; }

}  // namespace splatboost
