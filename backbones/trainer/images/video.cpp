// SPDX-License-Identifier: Apache-2.0
#include "trainer/images/video.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include <opencv2/core/utils/logger.hpp>
#include <opencv2/videoio.hpp>

#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

namespace fs = std::filesystem;

constexpr double kUsualRate = 30;  ///< frames per second of a video that does not state it

/// Silences OpenCV and FFmpeg. Done before main(): several threads open videos, and setenv() must not run while they
/// read the environment.
const bool kQuiet = [] {
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  ::setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);  // FFmpeg has its own log level
  return true;
}();

cv::VideoCapture open_video(const fs::path& path) {
  cv::VideoCapture capture;
  try {
    if (capture.open(path.string())) return capture;
  } catch (const cv::Exception&) {
    // reported below
  }
  throw InputError(path.string() +
                   ": OpenCV cannot read the video (damaged, or no codec); replace it with a folder of the same name "
                   "that contains its frames");
}

/// 0 if OpenCV cannot read the video.
std::size_t readable_frames(const fs::path& path) {
  try {
    return measure_video(path, 0).readable;
  } catch (const InputError&) {
    return 0;
  }
}

}  // namespace

struct VideoFile::State {
  fs::path path;
  std::optional<TemporaryFile> unfinished;
  int width = 0;
  int height = 0;
  cv::Mat frame;
  std::size_t frames = 0;  ///< added so far
  cv::VideoWriter writer;  ///< after `unfinished`, so that it is closed first
};

VideoFile::VideoFile(const fs::path& path, int width, int height, double frames_per_second)
    : state_(std::make_unique<State>()) {
  require_video_name(path);
  const fs::path target = file_to_replace(path);
  state_->width = width;
  state_->height = height;
  state_->frame = cv::Mat(height / 2 * 2, width / 2 * 2, CV_8UC3);
  if (state_->frame.empty()) throw InputError(path.string() + ": images are too small for a video");
  state_->path = target;
  remove_stale_files(fs::absolute(target).parent_path());
  // OpenCV chooses the container by the ending. It opens this file and keeps it, and with it the lock.
  state_->unfinished.emplace(target, path.extension().native());
  // A missing codec is reported in one line below, instead of OpenCV's many lines.
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  for (const char* codec : {"avc1", "mp4v"}) {
    const int fourcc = cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]);
    try {
      if (state_->writer.open(state_->unfinished->path.string(), fourcc, frames_per_second, state_->frame.size()))
        return;
    } catch (const cv::Exception&) {
      // try the next codec
    }
  }
  throw InputError(path.string() + ": OpenCV cannot write the video (no codec); omit --video to write PNG files");
}

VideoFile::~VideoFile() = default;

void VideoFile::add(std::span<const float> color) {
  const auto plane = static_cast<std::size_t>(state_->width) * static_cast<std::size_t>(state_->height);
  for (int y = 0; y < state_->frame.rows; ++y) {
    unsigned char* row = state_->frame.ptr(y);
    for (int x = 0; x < state_->frame.cols; ++x) {
      const std::size_t pixel =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(state_->width) + static_cast<std::size_t>(x);
      for (std::size_t c = 0; c < 3; ++c) {
        row[3 * static_cast<std::size_t>(x) + c] =
            static_cast<unsigned char>(std::lround(std::clamp(color[(2 - c) * plane + pixel], 0.0f, 1.0f) * 255.0f));
      }
    }
  }
  state_->writer.write(state_->frame);
  ++state_->frames;
}

void VideoFile::finish() {
  state_->writer.release();
  // OpenCV does not report failed writes.
  if (readable_frames(state_->unfinished->path) != state_->frames) {
    throw std::runtime_error(state_->path.string() +
                             ": cannot write the video: it is incomplete; the disk may be full");
  }
  std::error_code error;
  fs::rename(state_->unfinished->path, state_->path, error);
  if (error) throw std::runtime_error(state_->path.string() + ": cannot write the video: " + error.message());
  state_->unfinished->renamed = true;
}

struct VideoFrames::State {
  fs::path path;
  cv::VideoCapture capture;
  std::size_t frames = 0;  ///< read, or passed, so far
};

VideoFrames::VideoFrames(const fs::path& path) : state_(std::make_unique<State>()) {
  state_->path = path;
  state_->capture = open_video(path);
}

VideoFrames::~VideoFrames() = default;

Pixels VideoFrames::next() {
  cv::Mat frame;
  const bool read = state_->capture.read(frame);
  const std::size_t number = state_->frames++;
  if (!read || frame.empty() || frame.type() != CV_8UC3) {
    throw InputError(state_->path.string() + ": frame " + std::to_string(number) +
                     " of the video cannot be read; copy it again");
  }
  Pixels pixels{frame.cols, frame.rows, 3, 8, {}};
  pixels.bytes.reserve(3 * static_cast<std::size_t>(frame.cols) * static_cast<std::size_t>(frame.rows));
  for (int y = 0; y < frame.rows; ++y) {
    const unsigned char* const row = frame.ptr(y);
    for (int x = 0; x < frame.cols; ++x) {
      for (int c = 2; c >= 0; --c) pixels.bytes.push_back(row[3 * x + c]);
    }
  }
  return pixels;
}

void VideoFrames::skip() {
  state_->capture.grab();
  ++state_->frames;
}

VideoLength measure_video(const fs::path& path, std::size_t most) {
  cv::VideoCapture capture = open_video(path);
  VideoLength length;
  const double claimed = capture.get(cv::CAP_PROP_FRAME_COUNT);
  if (claimed >= 1 && claimed < 1e7) length.claimed = static_cast<std::size_t>(claimed);
  const double rate = capture.get(cv::CAP_PROP_FPS);
  const double step = 1 / (rate >= 1e-3 && rate <= 1e5 ? rate : kUsualRate);
  while ((most == 0 || length.readable < most) && capture.grab()) {
    ++length.readable;
    double time = capture.get(cv::CAP_PROP_POS_MSEC) / 1000;
    // OpenCV 4.6 does not give the times of the last frames if the decoder delays frames.
    if (!length.times.empty() && !(time > length.times.back())) time = length.times.back() + step;
    length.times.push_back(time);
  }
  return length;
}

}  // namespace splatboost
