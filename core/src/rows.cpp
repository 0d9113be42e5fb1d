// SPDX-License-Identifier: Apache-2.0
#include "splatboost/rows.h"

#include <algorithm>

#include "cuda_operations.h"
#include "splatboost/errors.h"

namespace splatboost {

void remove_rows(std::vector<float>& tensor, std::size_t width, std::span<const std::uint8_t> removed) {
  SPLATBOOST_CHECK(width > 0, "width must be above 0");
  SPLATBOOST_CHECK(tensor.size() == width * removed.size(), "removed must have one byte a row");
  std::size_t kept = 0;
  for (std::size_t i = 0; i < removed.size(); ++i) {
    if (removed[i] != 0) continue;
    if (kept != i) {
      std::copy_n(tensor.begin() + static_cast<std::ptrdiff_t>(i * width), width,
                  tensor.begin() + static_cast<std::ptrdiff_t>(kept * width));
    }
    ++kept;
  }
  tensor.resize(kept * width);
}

void append_rows(std::vector<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows) {
  SPLATBOOST_CHECK(width > 0, "width must be above 0");
  const std::size_t before = tensor.size();
  SPLATBOOST_CHECK(before % width == 0, "tensor must hold whole rows of width");
  for (const std::size_t row : rows) SPLATBOOST_CHECK(row < before / width, "rows must name rows that exist");
  tensor.resize(before + width * rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    std::copy_n(tensor.begin() + static_cast<std::ptrdiff_t>(rows[i] * width), width,
                tensor.begin() + static_cast<std::ptrdiff_t>(before + i * width));
  }
}

void reorder_rows(std::vector<float>& tensor, std::size_t width, std::span<const std::uint32_t> order) {
  SPLATBOOST_CHECK(width > 0, "width must be above 0");
  SPLATBOOST_CHECK(tensor.size() == width * order.size(), "order must have one entry a row");
  std::vector<float> ordered;
  ordered.reserve(tensor.size());
  for (const std::size_t row : order) {
    SPLATBOOST_CHECK(row < order.size(), "order must name rows that exist");
    const auto from = tensor.begin() + static_cast<std::ptrdiff_t>(row * width);
    ordered.insert(ordered.end(), from, from + static_cast<std::ptrdiff_t>(width));
  }
  tensor.swap(ordered);
}

void append_zero_rows(std::vector<float>& tensor, std::size_t width, std::size_t count) {
  SPLATBOOST_CHECK(width > 0, "width must be above 0");
  tensor.resize(tensor.size() + width * count, 0.0f);
}

void remove_rows(DeviceArray<float>& tensor, std::size_t width, std::span<const std::uint8_t> removed) {
  SPLATBOOST_CHECK(width > 0, "width must be above 0");
  SPLATBOOST_CHECK(tensor.size() == width * removed.size(), "removed must have one byte a row");
  cuda::remove_rows(tensor, width, removed);
}

void append_rows(DeviceArray<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows) {
  SPLATBOOST_CHECK(width > 0, "width must be above 0");
  SPLATBOOST_CHECK(tensor.size() % width == 0, "tensor must hold whole rows of width");
  cuda::append_rows(tensor, width, rows);
}

void reorder_rows(DeviceArray<float>& tensor, std::size_t width, std::span<const std::uint32_t> order) {
  SPLATBOOST_CHECK(width > 0, "width must be above 0");
  SPLATBOOST_CHECK(tensor.size() == width * order.size(), "order must have one entry a row");
  cuda::reorder_rows(tensor, width, order);
}

void append_zero_rows(DeviceArray<float>& tensor, std::size_t width, std::size_t count) {
  SPLATBOOST_CHECK(width > 0, "width must be above 0");
  const std::size_t before = tensor.size();
  tensor.resize(before + width * count);
  tensor.stream().fill_zero(tensor.data() + before, width * count * sizeof(float));
}

}  // namespace splatboost
