// SPDX-License-Identifier: Apache-2.0
#include "program/session/scene_files.h"

#include <algorithm>
#include <string>
#include <utility>

#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_values.h"

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

std::vector<fs::path> scenes_of(const fs::path& model, const nlohmann::json& config, const fs::path& chosen) {
  std::vector<fs::path> scenes;
  const std::string file = (model / "config.json").string();
  for (const auto& [key, place] : {std::pair("/source", ": source"), std::pair("/slam/source", ": slam: source")}) {
    const nlohmann::json::json_pointer pointer(key);
    if (config.contains(pointer)) read_value(config.at(pointer), file + place, scenes.emplace_back());
  }
  if (!chosen.empty() && std::ranges::find(scenes, chosen) == scenes.end()) scenes.push_back(chosen);
  return scenes;
}

void require_no_scene_file(const fs::path& output, const std::vector<fs::path>& scenes, const fs::path& own) {
  require_replaceable(output, scenes);
  for (const fs::path& scene : scenes) {
    require(!lies_in(output, scene) || lies_in(output, own),
            output.string() + ": exists in the folder of the scene, whose data it may be; name another place to write");
  }
}

}  // namespace splatboost::program
