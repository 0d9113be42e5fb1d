// SPDX-License-Identifier: Apache-2.0
/// @file Files of a scene, which no output may replace.
#pragma once

#include <filesystem>

namespace splatboost::program {

/// Whether the file is in the folder or below it, by its name or behind links. False unless both exist.
bool lies_in(const std::filesystem::path& file, const std::filesystem::path& folder);

/// Throws InputError if the output would replace a file in the folder of a scene, which may be data of it.
/// @param own a folder of results, which may be in that of the scene; its files may be replaced. May be empty
void require_no_scene_file(const std::filesystem::path& output, const std::filesystem::path& scene,
                           const std::filesystem::path& own = {});

}  // namespace splatboost::program
