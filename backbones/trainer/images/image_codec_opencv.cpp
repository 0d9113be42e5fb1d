// SPDX-License-Identifier: Apache-2.0
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <mutex>

#include "splatboost/threads.h"
#include "trainer/images/image_codec.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr int kPngCompression = 3;  // higher levels take much longer and save a few per cent

/// Turns off OpenCV's own warnings: errors are reported to the user in one line of ours.
void silence_opencv() {
  static const bool done = [] {
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
    return true;
  }();
  (void)done;
}

/// Redirects stderr to /dev/null while an instance exists: libpng, libjpeg and other decoders print messages of their
/// own, bypassing OpenCV's logger. Several threads may decode at once; nothing else in the program prints to stderr
/// meanwhile.
class QuietDecoders {
 public:
  QuietDecoders() {
    const std::lock_guard guard(mutex_);
    if (users_++ > 0) return;
    std::fflush(stderr);
    kept_ = ::dup(STDERR_FILENO);
    const int nowhere = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
    if (kept_ >= 0 && nowhere >= 0) ::dup2(nowhere, STDERR_FILENO);
    if (nowhere >= 0) ::close(nowhere);
  }
  ~QuietDecoders() {
    const std::lock_guard guard(mutex_);
    if (--users_ > 0 || kept_ < 0) return;
    std::fflush(stderr);
    ::dup2(kept_, STDERR_FILENO);
    ::close(kept_);
  }
  QuietDecoders(const QuietDecoders&) = delete;
  QuietDecoders& operator=(const QuietDecoders&) = delete;

 private:
  static inline std::mutex mutex_;
  static inline int users_ = 0;
  static inline int kept_ = -1;
};

/// A matrix that shares the memory of the pixels. If they are const, it must only be read.
cv::Mat wrap(const Pixels& pixels) {
  return cv::Mat(pixels.height, pixels.width, CV_MAKETYPE(pixels.bits == 8 ? CV_8U : CV_16U, pixels.channels),
                 const_cast<std::uint8_t*>(pixels.bytes.data()));
}

/// Allocates pixels of the given size. @return a matrix that shares their memory, to fill them
cv::Mat make_room(Pixels& pixels, int width, int height, int channels, int bits) {
  pixels.width = width;
  pixels.height = height;
  pixels.channels = channels;
  pixels.bits = bits;
  pixels.bytes.resize(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
                      static_cast<std::size_t>(channels * bits / 8));
  return wrap(pixels);
}

}  // namespace

bool have_opencv() { return true; }

// TBB, which OpenCV may use, prints a warning if it is to use more threads than there are CPUs.
void set_opencv_threads(int count) { cv::setNumThreads(std::min(count, available_cpus())); }

Pixels decode_image(std::span<const std::uint8_t> file, const std::string& where) {
  silence_opencv();
  cv::Mat image;
  try {
    const QuietDecoders quiet;
    image = cv::imdecode(cv::Mat(1, static_cast<int>(file.size()), CV_8U, const_cast<std::uint8_t*>(file.data())),
                         cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception& error) {
    throw InputError(where + ": the image cannot be decoded (" + error.err + ")");
  }
  require(!image.empty(),
          where + ": the image cannot be decoded; it is damaged or in a format that OpenCV does not support");
  require(image.depth() == CV_8U || image.depth() == CV_16U,
          where + ": holds neither 8-bit nor 16-bit pixels; convert it to PNG or JPEG");
  const int channels = image.channels();
  require(channels == 1 || channels == 3 || channels == 4,
          where + ": has " + std::to_string(channels) + " channels; convert it to RGB or RGBA");
  Pixels pixels;
  cv::Mat out = make_room(pixels, image.cols, image.rows, channels, image.depth() == CV_8U ? 8 : 16);
  if (channels == 1) image.copyTo(out);
  if (channels == 3) cv::cvtColor(image, out, cv::COLOR_BGR2RGB);
  if (channels == 4) cv::cvtColor(image, out, cv::COLOR_BGRA2RGBA);
  return pixels;
}

std::vector<std::uint8_t> encode_png(const Pixels& pixels, const std::string& where) {
  silence_opencv();
  cv::Mat stored;
  if (pixels.channels == 1) stored = wrap(pixels);
  if (pixels.channels == 3) cv::cvtColor(wrap(pixels), stored, cv::COLOR_RGB2BGR);
  if (pixels.channels == 4) cv::cvtColor(wrap(pixels), stored, cv::COLOR_RGBA2BGRA);
  std::vector<std::uint8_t> file;
  require(cv::imencode(".png", stored, file, {cv::IMWRITE_PNG_COMPRESSION, kPngCompression}),
          where + ": OpenCV cannot encode PNG");
  return file;
}

Pixels shrink_image(const Pixels& pixels, int width, int height, const std::string& where) {
  Pixels smaller;
  cv::Mat out = make_room(smaller, width, height, pixels.channels, pixels.bits);
  try {
    cv::resize(wrap(pixels), out, out.size(), 0, 0, cv::INTER_AREA);
  } catch (const cv::Exception& error) {
    throw InputError(where + ": the image cannot be resized (" + error.err + ")");
  }
  return smaller;
}

Pixels resample_image(const Pixels& pixels, std::span<const float> positions, const std::string& where) {
  const cv::Mat map(pixels.height, pixels.width, CV_32FC2, const_cast<float*>(positions.data()));
  Pixels result;
  cv::Mat out = make_room(result, pixels.width, pixels.height, pixels.channels, pixels.bits);
  try {
    cv::remap(wrap(pixels), out, map, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  } catch (const cv::Exception& error) {
    throw InputError(where + ": the image cannot be undistorted (" + error.err + ")");
  }
  return result;
}

}  // namespace splatboost
