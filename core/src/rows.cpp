// SPDX-License-Identifier: Apache-2.0
#include "splatboost/rows.h"

#include <algorithm>

#include "splatboost/errors.h"

namespace splatboost {

void remove_rows(std::vector<float>& tensor, std::size_t width, std::span<const std::uint8_t> removed) {
  SPLATBOOST_CHECK(tensor.size() == width * removed.size(), "the mask must have one byte a row");
  std::size_t kept = 0;
  for (std::size_t i = 0; i < removed.size(); ++i) {
    if (removed[i] != 0) continue;
    if (kept != i) std::copy_n(tensor.begin() + static_cast<std::ptrdiff_t>(i * width), width, tensor.begin() + static_cast<std::ptrdiff_t>(kept * width));
    ++kept;
  }
  tensor.resize(kept * width);
}

void append_rows(std::vector<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows) {
  const std::size_t before = tensor.size();
  tensor.resize(before + width * rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    SPLATBOOST_CHECK((rows[i] + 1) * width <= before, "a row to copy must exist");
    std::copy_n(tensor.begin() + static_cast<std::ptrdiff_t>(rows[i] * width), width,
                tensor.begin() + static_cast<std::ptrdiff_t>(before + i * width));
  }
}

void append_zero_rows(std::vector<float>& tensor, std::size_t width, std::size_t count) {
  tensor.resize(tensor.size() + width * count, 0.0f);
}

}  // namespace splatboost
