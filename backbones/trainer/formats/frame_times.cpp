// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/frame_times.h"

#include <algorithm>
#include <charconv>

#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr char kDigits[] = "0123456789";

}  // namespace

std::int64_t frame_number(const std::string& name) {
  const std::string stem = std::filesystem::path(name).stem().string();
  const std::size_t last = stem.find_last_of(kDigits);
  if (last == std::string::npos) return -1;
  const std::size_t before = stem.find_last_not_of(kDigits, last);
  const std::size_t begin = before == std::string::npos ? 0 : before + 1;
  std::int64_t frame = -1;
  const auto parsed = std::from_chars(stem.data() + begin, stem.data() + last + 1, frame);
  return parsed.ec == std::errc{} ? frame : -1;
}

std::string set_frame_times(std::vector<Photo>& photos, const std::string& where) {
  require(!photos.empty(), where + ": lists no images");
  std::vector<std::int64_t> frames;
  for (const Photo& photo : photos) {
    frames.push_back(frame_number(photo.name));
    require(frames.back() >= 0,
            where + ": the name of image '" + photo.name + "' has no frame number, which --frame-times requires");
  }
  const auto [first, last] = std::ranges::minmax(frames);
  require(last > first, where + ": all images have frame number " + std::to_string(first) + ", so they have no times");
  for (std::size_t i = 0; i < photos.size(); ++i) {
    photos[i].time = static_cast<double>(frames[i] - first) / static_cast<double>(last - first);
  }
  const std::string range = std::to_string(first) + " to " + std::to_string(last);
  std::ranges::sort(frames);
  const auto different = std::unique(frames.begin(), frames.end()) - frames.begin();
  return "the names of " + std::to_string(photos.size()) + " images have " + std::to_string(different) +
         " different frame numbers, " + range;
}

}  // namespace splatboost
