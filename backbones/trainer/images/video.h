// SPDX-License-Identifier: Apache-2.0
/// @file Renders as a film, and films as photos.
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>

#include "trainer/images/image_codec.h"

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

/// The frames of a video, in order. Both throw InputError where it cannot be read.
class VideoFrames {
 public:
  explicit VideoFrames(const std::filesystem::path& path);
  ~VideoFrames();
  VideoFrames(const VideoFrames&) = delete;
  VideoFrames& operator=(const VideoFrames&) = delete;

  /// The next one, RGB of 8 bits.
  Pixels next();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

struct VideoLength {
  std::size_t readable = 0;  ///< frames from the beginning on that VideoFrames gives
  std::size_t claimed = 0;   ///< that the file says it has; 0: it does not say
};

/// Decodes a video to tell how long it is. Throws InputError where it cannot be read at all.
/// @param most frames to look for; 0: all
VideoLength measure_video(const std::filesystem::path& path, std::size_t most);

}  // namespace splatboost
