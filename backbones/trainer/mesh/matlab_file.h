// SPDX-License-Identifier: Apache-2.0
/// @file Reads numeric arrays from MATLAB files (.mat) with libmatio. Without it, reading throws InputError.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace splatboost {

/// The first dimension of the shape runs fastest, as MATLAB stores arrays.
template <class Number>
struct MatlabArray {
  std::vector<std::size_t> shape;
  std::vector<Number> values;
};

/// Reads one array of real numbers or booleans by name; read_matlab_flags() gives 1 where a value is not 0. Throws
/// InputError if the file is not a MATLAB file, or if the array is missing, empty or of another type.
MatlabArray<double> read_matlab_numbers(const std::filesystem::path& path, const std::string& name);
MatlabArray<std::uint8_t> read_matlab_flags(const std::filesystem::path& path, const std::string& name);

/// Whether this build can read MATLAB files.
bool has_matlab_files();

}  // namespace splatboost
