// SPDX-License-Identifier: Apache-2.0
/// @file Renders as a film.
#pragma once

#include <filesystem>
#include <memory>
#include <span>

namespace splatboost {

/// A video file that appears when it is whole. Its codec is H.264 where OpenCV was built with it, else MPEG-4.
class VideoFile {
 public:
  /// Sides are cut to even numbers, as codecs want them. Throws InputError if no codec or no file can be opened.
  VideoFile(const std::filesystem::path& path, int width, int height, double frames_per_second);
  /// Removes what finish() has not completed.
  ~VideoFile();
  VideoFile(const VideoFile&) = delete;
  VideoFile& operator=(const VideoFile&) = delete;

  /// @param color [3,H,W], clamped to [0,1]
  void add(std::span<const float> color);
  void finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost
