// SPDX-License-Identifier: Apache-2.0
/// @file Arrays of numbers in MATLAB's files (.mat), by libmatio. A build without it reads none, and says so.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace splatboost {

/// The first of the shape runs fastest, as MATLAB stores them.
template <class Number>
struct MatlabArray {
  std::vector<std::size_t> shape;
  std::vector<Number> values;
};

/// Reads one array of real numbers or truth values by its name; the second gives 1 where a number is not 0. Throws
/// InputError on a file that is none of MATLAB's, and where the array is missing, of another kind or empty.
MatlabArray<double> read_matlab_numbers(const std::filesystem::path& path, const std::string& name);
MatlabArray<std::uint8_t> read_matlab_flags(const std::filesystem::path& path, const std::string& name);

/// Whether this build reads them.
bool has_matlab_files();

}  // namespace splatboost
