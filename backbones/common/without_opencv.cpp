// SPDX-License-Identifier: Apache-2.0
// What a build without OpenCV says where it would need it.
#include "common/input_error.h"
#include "common/metrics.h"
#include "common/report_pictures.h"
#include "common/video.h"

namespace splatboost {

struct Lpips::Network {};

Lpips::Lpips(const std::filesystem::path&) {
  throw InputError("LPIPS needs OpenCV, which this build does not have; leave out --lpips");
}

Lpips::~Lpips() = default;

double Lpips::distance(std::span<const float>, const TruthImage&) { return 0; }  // there is no object to call it on

struct VideoFile::State {};

VideoFile::VideoFile(const std::filesystem::path& path, int, int, double) {
  throw InputError(path.string() +
                   ": a video needs OpenCV, which this build does not have; leave out --video for PNG files");
}

VideoFile::~VideoFile() = default;
void VideoFile::add(std::span<const float>) {}
void VideoFile::finish() {}

ReportPicture report_picture(const std::filesystem::path&) { return {}; }
ReportPicture report_error_picture(const std::filesystem::path&, const std::filesystem::path&) { return {}; }
std::string report_error_colors() { return ""; }

}  // namespace splatboost
