// SPDX-License-Identifier: Apache-2.0
/// @file Reads numpy arrays of floats, .npy.
#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

namespace splatboost {

struct NpyArray {
  std::vector<std::size_t> shape;
  std::vector<double> values;  ///< row-major: the last index varies fastest
};

/// Reads a row-major array of little-endian 32- or 64-bit floats, of at most `most_dimensions` dimensions. Throws
/// InputError in one line on anything else, and on a file that is cut short.
NpyArray read_npy(const std::filesystem::path& file, std::size_t most_dimensions = 2);

}  // namespace splatboost
