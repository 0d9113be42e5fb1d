// SPDX-License-Identifier: Apache-2.0
// Replaces matlab_file_matio.cpp in a build without libmatio.
#include "trainer/mesh/matlab_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

[[noreturn]] void refuse(const std::filesystem::path& path) {
  throw InputError(path.string() +
                   ": this build cannot read MATLAB files; install libmatio (Debian: libmatio-dev) and build again");
}

}  // namespace

MatlabArray<double> read_matlab_numbers(const std::filesystem::path& path, const std::string&) { refuse(path); }
MatlabArray<std::uint8_t> read_matlab_flags(const std::filesystem::path& path, const std::string&) { refuse(path); }

bool has_matlab_files() { return false; }

}  // namespace splatboost
