// SPDX-License-Identifier: Apache-2.0
/// @file Writes renders to a video file, and reads videos as photos.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "trainer/images/image_codec.h"
#include "trainer/support/input_error.h"

namespace splatboost {

/// Throws InputError unless the name ends like the containers that VideoFile writes. Given the name of a picture,
/// OpenCV would write one picture for all frames.
inline void require_video_name(const std::filesystem::path& path) {
  constexpr std::array<std::string_view, 4> kEndings = {".mp4", ".mov", ".mkv", ".avi"};
  require(std::ranges::find(kEndings, path.extension().native()) != kEndings.end(),
          path.string() + ": the file name of a video must end in .mp4, .mov, .mkv or .avi");
}

/// Writes a video file, which gets its name in finish(). The codec is H.264 if OpenCV was built with it, else MPEG-4.
class VideoFile {
 public:
  /// Crops width and height to even numbers, as codecs require. Removes what killed processes left beside `path`.
  /// Throws InputError if no codec or file can be opened, or as require_video_name() does.
  VideoFile(const std::filesystem::path& path, int width, int height, double frames_per_second);
  /// Removes the unfinished file unless finish() succeeded.
  ~VideoFile();
  VideoFile(const VideoFile&) = delete;
  VideoFile& operator=(const VideoFile&) = delete;

  /// @param color [3,H,W], clamped to [0,1]
  void add(std::span<const float> color);
  /// Closes the file, reads all frames back and renames it to `path`. Throws std::runtime_error if that fails.
  void finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Reads the frames of a video in order. The constructor and next() throw InputError if the video cannot be read.
class VideoFrames {
 public:
  explicit VideoFrames(const std::filesystem::path& path);
  ~VideoFrames();
  VideoFrames(const VideoFrames&) = delete;
  VideoFrames& operator=(const VideoFrames&) = delete;

  /// The next frame, 8-bit RGB.
  Pixels next();
  /// Passes the next frame, without the time to convert it.
  void skip();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

struct VideoLength {
  std::size_t readable = 0;   ///< frames from the beginning that VideoFrames can read
  std::size_t claimed = 0;    ///< frames according to the file; 0: not stated
  std::vector<double> times;  ///< [readable] seconds, ascending: as the file states, or by its frame rate
};

/// Counts the frames of a video by decoding it. Throws InputError if it cannot be opened.
/// @param most stop counting at this number of frames; 0: count all
VideoLength measure_video(const std::filesystem::path& path, std::size_t most);

}  // namespace splatboost
