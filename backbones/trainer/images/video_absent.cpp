// SPDX-License-Identifier: Apache-2.0
// Replaces video.cpp in a build without OpenCV: all constructors throw.
#include "trainer/images/video.h"
#include "trainer/support/input_error.h"

namespace splatboost {

struct VideoFile::State {};

VideoFile::VideoFile(const std::filesystem::path& path, int, int, double) {
  throw InputError(path.string() +
                   ": a video needs OpenCV, which this build does not have; omit --video to write PNG files");
}

VideoFile::~VideoFile() = default;
void VideoFile::add(std::span<const float>) {}
void VideoFile::finish() {}

struct VideoFrames::State {};

VideoFrames::VideoFrames(const std::filesystem::path& path) {
  throw InputError(path.string() +
                   ": a video needs OpenCV, which this build does not have; replace it with a folder of its frames");
}

VideoFrames::~VideoFrames() = default;
Pixels VideoFrames::next() { return {}; }
void VideoFrames::skip() {}

VideoLength measure_video(const std::filesystem::path& path, std::size_t) {
  const VideoFrames refused(path);
  return {};
}

}  // namespace splatboost
