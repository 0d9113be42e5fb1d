// SPDX-License-Identifier: Apache-2.0
/// @file The error caused by user input.
#pragma once

#include <stdexcept>
#include <string>

namespace splatboost::patch {

/// What is wrong, in which file, and what to do, in one line. Nothing was written.
class PatchError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A file of the tree cannot be read.
class ReadError : public PatchError {
 public:
  using PatchError::PatchError;
};

/// Writing to the disk failed. The message says so if anything was written; otherwise nothing was.
class WriteError : public PatchError {
 public:
  using PatchError::PatchError;
};

inline void require(bool holds, const std::string& what) {
  if (!holds) throw PatchError(what);
}

}  // namespace splatboost::patch
