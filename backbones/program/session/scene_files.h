// SPDX-License-Identifier: Apache-2.0
/// @file Files of a scene, which no output may replace.
#pragma once

#include <filesystem>
#include <vector>

#include <nlohmann/json.hpp>

namespace splatboost::program {

/// Whether the file is in the folder or below it, by its name or behind links. False unless both exist.
bool lies_in(const std::filesystem::path& file, const std::filesystem::path& folder);

/// Scenes whose data an output must not replace: that of the run in the model folder, the sequence of a run of slam,
/// and the one that is chosen instead. Throws InputError if a path in config.json is not a string.
/// @param config of the run, by read_config()
/// @param chosen may be empty
std::vector<std::filesystem::path> scenes_of(const std::filesystem::path& model, const nlohmann::json& config,
                                             const std::filesystem::path& chosen = {});

/// Throws InputError if the output would replace one of the scenes, which may be files, or a file in the folder of one,
/// which may be data of it.
/// @param own a folder of results, which may be in that of the scene; its files may be replaced. May be empty
void require_no_scene_file(const std::filesystem::path& output, const std::vector<std::filesystem::path>& scenes,
                           const std::filesystem::path& own = {});

}  // namespace splatboost::program
