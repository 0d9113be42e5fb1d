// SPDX-License-Identifier: Apache-2.0
#include "program/session/scene_files.h"

#include "trainer/support/input_error.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;

bool is_below(const fs::path& file, const fs::path& folder) {
  const fs::path relative = file.lexically_relative(folder);
  return !relative.empty() && *relative.begin() != "..";
}

}  // namespace

bool lies_in(const fs::path& file, const fs::path& folder) {
  std::error_code error;
  if (!fs::exists(file, error) || !fs::is_directory(folder, error)) return false;
  // By the names too: folders of scenes are often links.
  return is_below(fs::absolute(file).lexically_normal(), fs::absolute(folder).lexically_normal()) ||
         is_below(fs::weakly_canonical(file, error), fs::weakly_canonical(folder, error));
}

void require_no_scene_file(const fs::path& output, const fs::path& scene, const fs::path& own) {
  require(!lies_in(output, scene) || lies_in(output, own),
          output.string() + ": exists in the folder of the scene, whose data it may be; name another file to write");
}

}  // namespace splatboost::program
