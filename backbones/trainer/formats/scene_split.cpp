// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/scene_split.h"

#include <algorithm>
#include <fstream>
#include <string_view>

#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

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

}  // namespace

PhotoSplit split_photos(const SceneOptions& options, const std::vector<std::string>& names,
                        std::optional<std::size_t> own_test, const std::filesystem::path& listing) {
  PhotoSplit split;
  const auto put = [&](std::size_t photo, bool is_test) { (is_test ? split.test : split.train).push_back(photo); };
  const std::size_t count = names.size();
  if (!options.test_list.empty()) {
    const std::vector<std::string> listed = read_names(options.test_list);
    std::vector<bool> used(listed.size(), false);
    for (std::size_t photo = 0; photo < count; ++photo) {
      bool is_test = false;
      for (std::size_t i = 0; i < listed.size(); ++i) {
        if (!names_match(listed[i], names[photo])) continue;
        used[i] = true;
        is_test = true;
      }
      put(photo, is_test);
    }
    if (const auto unused = std::ranges::find(used, false); unused != used.end()) {
      throw InputError(options.test_list.string() + ": the test image '" +
                       listed[static_cast<std::size_t>(unused - used.begin())] + "' matches no image of " +
                       listing.string());
    }
  } else if (own_test) {
    // Without --eval nothing is held out, as in 3DGS.
    for (std::size_t photo = 0; photo < count; ++photo) put(photo, options.eval && photo >= count - *own_test);
  } else {
    const auto every = static_cast<std::size_t>(options.llffhold);
    for (std::size_t photo = 0; photo < count; ++photo) put(photo, options.eval && photo % every == 0);
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
