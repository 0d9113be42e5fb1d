// SPDX-License-Identifier: Apache-2.0
#include "trainer/sequence/sequence.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <new>
#include <optional>
#include <utility>

#include "trainer/images/image_codec.h"
#include "trainer/images/image_damage.h"
#include "trainer/images/video.h"
#include "trainer/sequence/sequence_files.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

namespace fs = std::filesystem;

Pixels read_image(const fs::path& file) {
  require(!fs::is_directory(file), file.string() + ": is not a file");
  std::ifstream in(file, std::ios::binary);
  require(in.good(), file.string() + ": cannot be read");
  const std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  require_whole_image(bytes, file.string());
  return decode_image(bytes, file.string());
}

/// [H,W,2] position x, y in the distorted image of each pixel of the undistorted image; far outside of it if there is
/// none.
std::vector<float> distorted_places(const Calibration& c) {
  constexpr double kFarOutside = -1e4;
  const DistortedPlaces distorted(c);
  std::vector<float> places;
  places.reserve(2 * static_cast<std::size_t>(c.width) * static_cast<std::size_t>(c.height));
  for (int row = 0; row < c.height; ++row) {
    for (int column = 0; column < c.width; ++column) {
      const glm::dvec2 place = distorted.of(column, row).value_or(glm::dvec2(kFarOutside));
      places.push_back(static_cast<float>(place.x));
      places.push_back(static_cast<float>(place.y));
    }
  }
  return places;
}

class FileSequence final : public Sequence {
 public:
  explicit FileSequence(SequenceFiles files) : files_(std::move(files)), calibration_(files_.calibration) {
    const Calibration& c = files_.calibration;
    if (files_.stereo) {
      stereo_.emplace(*files_.stereo);
      calibration_ = stereo_->calibration();
      for (FrameFiles& frame : files_.frames) {
        if (frame.truth) *frame.truth = *frame.truth * stereo_->left_from_rectified();
      }
      return;
    }
    if (!BrownConrady{c.k1, c.k2, c.k3, c.p1, c.p2}.is_identity()) places_ = distorted_places(c);
  }

  std::size_t size() const override { return files_.frames.size(); }
  const Calibration& calibration() const override { return calibration_; }
  std::vector<std::string> notes() const override { return files_.notes; }
  bool computes_depth() const override { return stereo_.has_value(); }
  double time_of(std::size_t number) const override { return files_.frames[number].time; }
  std::string name_of(std::size_t number) const override { return files_.frames[number].name; }
  std::optional<glm::dmat4> truth(std::size_t number) const override { return files_.frames[number].truth; }

  SequenceFrame read(std::size_t number) override {
    const FrameFiles& files = files_.frames[number];
    SequenceFrame frame;
    frame.number = number;
    frame.time = files.time;
    frame.name = files.name;
    frame.width = files_.calibration.width;
    frame.height = files_.calibration.height;
    try {
      frame.color = files.video_frame < 0 ? read_color(files.color) : color_of(video_frame(files), files.color);
      if (stereo_) stereo_->rectify_left(frame.color, frame.valid);
      if (!places_.empty()) mark_valid(frame);
    } catch (const std::bad_alloc&) {
      throw;  // the frame can be read
    } catch (const std::exception& error) {
      frame.color.clear();
      frame.problem = error.what();
      return frame;
    }
    if (!calibration_.has_depth()) return frame;
    try {
      if (files.depth.empty()) {
        throw InputError(files.color.string() + (stereo_ ? ": has no second image" : ": has no depth image"));
      }
      if (stereo_) {
        frame.depth = stereo_->depth(frame.color, read_color(files.depth));
      } else {
        read_depth(files.depth, frame);
      }
    } catch (const std::bad_alloc&) {
      throw;
    } catch (const std::exception& error) {
      frame.depth.clear();
      frame.problem = error.what();
    }
    return frame;
  }

 private:
  void require_size(const Pixels& pixels, const fs::path& file) const {
    const Calibration& c = files_.calibration;
    require(pixels.width == c.width && pixels.height == c.height,
            file.string() + ": has " + std::to_string(pixels.width) + "x" + std::to_string(pixels.height) +
                " pixels, but the calibration has " + std::to_string(c.width) + "x" + std::to_string(c.height));
  }

  /// Decodes a video onwards, or again from its beginning for an earlier frame.
  Pixels video_frame(const FrameFiles& files) {
    if (!video_ || files.video_frame < next_in_video_) {
      video_.emplace(files.color);
      next_in_video_ = 0;
    }
    for (; next_in_video_ < files.video_frame; ++next_in_video_) video_->skip();
    ++next_in_video_;  // first, because a frame that cannot be read is passed too
    return video_->next();
  }

  /// [H,W,3]
  std::vector<std::uint8_t> read_color(const fs::path& file) const { return color_of(read_image(file), file); }

  std::vector<std::uint8_t> color_of(Pixels pixels, const fs::path& file) const {
    require_size(pixels, file);
    require(pixels.bits == 8, file.string() + ": colour images must have 8 bits per channel");
    if (!places_.empty()) pixels = resample_image(pixels, places_, file.string());
    const std::size_t count = static_cast<std::size_t>(pixels.width) * static_cast<std::size_t>(pixels.height);
    const auto channels = static_cast<std::size_t>(pixels.channels);
    std::vector<std::uint8_t> color(3 * count);
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t c = 0; c < 3; ++c) color[3 * i + c] = pixels.bytes[channels * i + (channels < 3 ? 0 : c)];
    }
    return color;
  }

  void mark_valid(SequenceFrame& frame) const {
    frame.valid.resize(frame.color.size() / 3);
    for (std::size_t i = 0; i < frame.valid.size(); ++i) frame.valid[i] = inside(i) ? 255 : 0;
  }

  bool inside(std::size_t pixel) const {
    const float x = places_[2 * pixel], y = places_[2 * pixel + 1];
    return x >= 0 && y >= 0 && x <= static_cast<float>(files_.calibration.width - 1) &&
           y <= static_cast<float>(files_.calibration.height - 1);
  }

  void read_depth(const fs::path& file, SequenceFrame& frame) const {
    const Pixels pixels = read_image(file);
    require_size(pixels, file);
    require(pixels.bits == 16 && pixels.channels == 1, file.string() + ": depth images must have one 16-bit channel");
    const std::size_t count = static_cast<std::size_t>(frame.width) * static_cast<std::size_t>(frame.height);
    frame.depth.resize(count);
    bool any = false;
    for (std::size_t i = 0; i < count; ++i) {
      std::size_t from = i;
      if (!places_.empty()) {  // nearest pixel: interpolating across a depth edge is wrong
        if (!inside(i)) continue;
        from = static_cast<std::size_t>(std::lround(places_[2 * i + 1])) * static_cast<std::size_t>(frame.width) +
               static_cast<std::size_t>(std::lround(places_[2 * i]));
      }
      std::uint16_t value = 0;
      std::memcpy(&value, &pixels.bytes[2 * from], sizeof(value));
      if (value == std::numeric_limits<std::uint16_t>::max()) continue;  // out of the range, or marked as invalid
      any = any || value != 0;
      frame.depth[i] = static_cast<float>(value / files_.calibration.depth_scale);
    }
    require(any, file.string() + ": contains no depth values");
  }

  SequenceFiles files_;
  Calibration calibration_;            ///< of the frames returned
  std::optional<StereoDepth> stereo_;  ///< set for stereo pairs
  std::vector<float> places_;          ///< distorted_places(); empty: no distortion
  std::optional<VideoFrames> video_;   ///< open while frames of a video are read
  int next_in_video_ = 0;
};

}  // namespace

std::unique_ptr<Sequence> open_sequence(const SequenceOptions& options) {
  require(options.first >= 0 && options.count >= 0 && options.stride >= 1,
          "the first frame and the number of frames must be at least 0, and the stride at least 1");
  return std::make_unique<FileSequence>(find_sequence_files(options));
}

}  // namespace splatboost
