// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/json_values.h"

#include <array>
#include <charconv>

namespace splatboost {

nlohmann::json readable(float value) {
  std::array<char, 32> text{};
  const auto written = std::to_chars(text.data(), text.data() + text.size(), value);
  double decimal = value;
  std::from_chars(text.data(), written.ptr, decimal);
  return decimal;
}

}  // namespace splatboost
