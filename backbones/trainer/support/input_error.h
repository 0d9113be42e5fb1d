// SPDX-License-Identifier: Apache-2.0
/// @file Errors caused by user input, as opposed to failures.
#pragma once

#include <stdexcept>
#include <string>

namespace splatboost {

/// Bad input. The message says in one line what is wrong, where, and what to do; the program prints it and exits with
/// 2. Every other exception is a failure and exits with 1.
class InputError : public std::runtime_error {
 public:
  /// A zero byte in the message, as from a damaged name, is written as \x00: it would end what().
  explicit InputError(const std::string& message);
};

inline void require(bool holds, const std::string& what) {
  if (!holds) throw InputError(what);
}

}  // namespace splatboost
