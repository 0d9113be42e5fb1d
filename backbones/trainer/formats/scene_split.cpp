// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/scene_split.h"

#include <algorithm>
#include <fstream>
#include <string_view>
#include <utility>

#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"
#include "trainer/support/text.h"

namespace splatboost {
namespace {

constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";  // some editors begin UTF-8 files with it

/// Names in a list file, one per line; empty lines and # comments are skipped.
std::vector<std::string> read_names(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!is_file(file) || !in) throw InputError(file.string() + ": the list of test images cannot be opened");
  std::vector<std::string> names;
  bool first = true;
  for (std::string line; std::getline(in, line); first = false) {
    if (first && line.starts_with(kByteOrderMark)) line.erase(0, kByteOrderMark.size());
    const std::size_t begin = line.find_first_not_of(" \t\r");
    if (begin == std::string::npos || line[begin] == '#') continue;
    names.push_back(line.substr(begin, line.find_last_not_of(" \t\r") - begin + 1));
  }
  if (names.empty()) throw InputError(file.string() + ": the list of test images is empty");
  return names;
}

/// A listed name may omit the folder, the extension, or both.
bool names_match(const std::string& listed, const std::string& name) {
  const std::filesystem::path path(name);
  return listed == name || listed == path.filename().string() || listed == path.stem().string() ||
         listed == (path.parent_path() / path.stem()).generic_string();
}

/// One line if a listed name matches several images, such as r_0 those of several folders; else empty.
/// @param matches number of images that each listed name matches
std::string note_on_several(const std::filesystem::path& list, const std::vector<std::string>& listed,
                            const std::vector<std::size_t>& matches) {
  const auto several = [](std::size_t found) { return found > 1; };
  const auto first = std::ranges::find_if(matches, several);
  if (first == matches.end()) return {};
  const auto others = std::ranges::count_if(matches, several) - 1;
  return list.string() + ": '" + listed[static_cast<std::size_t>(first - matches.begin())] + "' matches " +
         std::to_string(*first) + " images, which are all held out" +
         (others > 0 ? " (as with " + std::to_string(others) + " more of its names)" : "") +
         "; name an image with its folder to hold out that one alone";
}

/// @param first_own_test index of the first photo of the dataset's own test split
PhotoSplit split_by_list(const std::filesystem::path& list, const std::vector<std::string>& names,
                         std::size_t first_own_test, const std::filesystem::path& listing) {
  const std::vector<std::string> listed = read_names(list);
  std::vector<std::size_t> matches(listed.size(), 0);
  PhotoSplit split;
  std::size_t unused = 0;
  for (std::size_t photo = 0; photo < names.size(); ++photo) {
    bool is_test = false;
    for (std::size_t i = 0; i < listed.size(); ++i) {
      if (!names_match(listed[i], names[photo])) continue;
      ++matches[i];
      is_test = true;
    }
    if (is_test) {
      split.test.push_back(photo);
    } else if (photo < first_own_test) {
      split.train.push_back(photo);
    } else {
      ++unused;  // test images of the dataset are not trained on
    }
  }
  if (const auto none = std::ranges::find(matches, std::size_t{0}); none != matches.end()) {
    throw InputError(list.string() + ": the test image '" + listed[static_cast<std::size_t>(none - matches.begin())] +
                     "' matches no image of " + listing.string());
  }
  if (unused > 0) {
    split.notes.push_back(counted(unused, "image") + " of the dataset's own test split " +
                          (unused == 1 ? "is" : "are") + " not in " + list.string() +
                          ": neither trained on nor tested");
  }
  if (std::string note = note_on_several(list, listed, matches); !note.empty()) split.notes.push_back(std::move(note));
  return split;
}

}  // namespace

PhotoSplit split_photos(const SceneOptions& options, const std::vector<std::string>& names,
                        std::optional<std::size_t> own_test, const std::filesystem::path& listing) {
  PhotoSplit split;
  const auto put = [&](std::size_t photo, bool is_test) { (is_test ? split.test : split.train).push_back(photo); };
  const std::size_t count = names.size();
  if (!options.test_list.empty()) {
    split = split_by_list(options.test_list, names, count - own_test.value_or(0), listing);
  } else if (own_test) {
    // Without --eval nothing is held out, as in 3DGS.
    for (std::size_t photo = 0; photo < count; ++photo) put(photo, options.eval && photo >= count - *own_test);
  } else {
    const auto every = static_cast<std::size_t>(options.llffhold);
    for (std::size_t photo = 0; photo < count; ++photo) put(photo, options.eval && photo % every == 0);
  }
  if (options.eval && options.llffhold != SceneOptions{}.llffhold && (own_test || !options.test_list.empty())) {
    split.notes.push_back("--llffhold has no effect: " + (options.test_list.empty()
                                                              ? listing.string() + " has its own test views"
                                                              : "--test-list names the test views"));
  }
  if (split.train.empty()) {
    const bool by_list = !options.test_list.empty();
    const std::string held_out = count == 1 ? "its only image is" : "all " + std::to_string(count) + " images are";
    std::string remedy = by_list ? "shorten the list of --test-list" : "raise --llffhold";
    // The first image is held out whatever --llffhold is.
    if (count == 1 || (!by_list && own_test)) remedy = by_list ? "leave out --test-list" : "leave out --eval";
    throw InputError(listing.string() + ": " + held_out + " held out for the test, none is left for training; " +
                     remedy);
  }
  return split;
}

std::vector<std::size_t> spread_evenly(const std::vector<std::size_t>& photos, std::size_t count) {
  if (count >= photos.size()) return photos;
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < count; ++i) {
    std::size_t index = 0;
    if (count > 1) {
      const std::size_t steps = count - 1, way = i * (photos.size() - 1);
      index = way / steps;
      const std::size_t twice_the_rest = 2 * (way % steps);
      if (twice_the_rest > steps || (twice_the_rest == steps && index % 2 == 1)) ++index;
    }
    kept.push_back(photos[index]);
  }
  return kept;
}

}  // namespace splatboost
