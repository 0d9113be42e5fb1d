// SPDX-License-Identifier: Apache-2.0
#include "splatboost/rows.h"

#include <algorithm>

#include "optim/cuda_ops.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

std::vector<float> gathered_rows(std::span<const float> from, std::size_t width, std::span<const std::uint32_t> rows) {
  std::vector<float> gathered;
  gathered.reserve(width * rows.size());
  for (const std::size_t row : rows) {
    SPLATBOOST_CHECK(width * (row + 1) <= from.size(), "the list must name rows that exist");
    const auto begin = from.begin() + static_cast<std::ptrdiff_t>(row * width);
    gathered.insert(gathered.end(), begin, begin + static_cast<std::ptrdiff_t>(width));
  }
  return gathered;
}

}  // namespace

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
  tensor = gathered_rows(tensor, width, order);
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

void select_rows(Array<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows,
                 Array<float>& workspace) {
  SPLATBOOST_CHECK(width > 0, "width must be above 0");
  SPLATBOOST_CHECK(tensor.size() % width == 0, "tensor must hold whole rows of width");
  if (!tensor.is_cuda()) return tensor.assign(gathered_rows(tensor, width, rows));
  workspace.ensure(width * rows.size());
  cuda::gather_rows(tensor, width, rows, workspace, tensor.cuda().stream());
  tensor.ensure(workspace.size());
  tensor.cuda().stream().copy_on_device(tensor.span().data(), workspace.span().data(), workspace.span().size_bytes());
}

void append_rows(Array<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows) {
  if (tensor.is_cuda()) return append_rows(tensor.cuda(), width, rows);
  append_rows(tensor.host(), width, rows);
}

void append_zero_rows(Array<float>& tensor, std::size_t width, std::size_t count) {
  if (tensor.is_cuda()) return append_zero_rows(tensor.cuda(), width, count);
  append_zero_rows(tensor.host(), width, count);
}

void append_rows_of(std::span<const float> from, std::size_t width, std::span<const std::uint32_t> rows,
                    Array<float>& tensor) {
  SPLATBOOST_CHECK(width > 0, "width must be above 0");
  if (!tensor.is_cuda()) {
    const std::vector<float> gathered = gathered_rows(from, width, rows);
    tensor.host().insert(tensor.host().end(), gathered.begin(), gathered.end());
    return;
  }
  const std::size_t before = tensor.size();
  tensor.resize(before + width * rows.size());
  cuda::gather_rows(from, width, rows, tensor.span().subspan(before), tensor.cuda().stream());
}

std::vector<std::uint32_t> kept_rows(std::span<const std::uint8_t> removed) {
  std::vector<std::uint32_t> kept;
  kept.reserve(removed.size());
  for (std::size_t i = 0; i < removed.size(); ++i) {
    if (removed[i] == 0) kept.push_back(static_cast<std::uint32_t>(i));
  }
  return kept;
}

}  // namespace splatboost
