// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

std::string with_zeros_shown(const std::string& message) {
  std::string shown;
  for (const char c : message) c == '\0' ? shown += "\\x00" : shown += c;
  return shown;
}

}  // namespace

InputError::InputError(const std::string& message) : std::runtime_error(with_zeros_shown(message)) {}

}  // namespace splatboost
