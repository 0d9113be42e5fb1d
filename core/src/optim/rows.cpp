// SPDX-License-Identifier: Apache-2.0
#include "splatboost/rows.h"

#include <algorithm>

#include "optim/cuda_ops.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

void check_tensor(std::size_t size, std::size_t width) {
  SPLATBOOST_CHECK(width > 0, "width must be above 0");
  SPLATBOOST_CHECK(size % width == 0, "tensor must contain whole rows of the given width");
}

std::vector<float> gathered_rows(std::span<const float> from, std::size_t width, std::span<const std::uint32_t> rows) {
  std::vector<float> gathered;
  gathered.reserve(width * rows.size());
  for (const std::size_t row : rows) {
    SPLATBOOST_CHECK(width * (row + 1) <= from.size(), "rows must contain existing row numbers");
    const auto begin = from.begin() + static_cast<std::ptrdiff_t>(row * width);
    gathered.insert(gathered.end(), begin, begin + static_cast<std::ptrdiff_t>(width));
  }
  return gathered;
}

}  // namespace

std::vector<std::uint32_t> kept_rows(std::span<const std::uint8_t> removed) {
  std::vector<std::uint32_t> kept;
  kept.reserve(removed.size());
  for (std::size_t i = 0; i < removed.size(); ++i) {
    if (removed[i] == 0) kept.push_back(static_cast<std::uint32_t>(i));
  }
  return kept;
}

void select_rows(Array<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows,
                 Array<float>& workspace) {
  check_tensor(tensor.size(), width);
  if (!tensor.is_cuda()) return tensor.assign(gathered_rows(tensor, width, rows));
  workspace.ensure(width * rows.size());
  cuda::gather_rows(tensor, width, rows, workspace, tensor.cuda().stream());
  tensor.ensure(workspace.size());
  tensor.cuda().stream().copy_on_device(tensor.span().data(), workspace.span().data(), workspace.span().size_bytes());
}

void append_rows_of(std::span<const float> from, std::size_t width, std::span<const std::uint32_t> rows,
                    Array<float>& tensor) {
  check_tensor(from.size(), width);
  if (!tensor.is_cuda()) {
    const std::vector<float> gathered = gathered_rows(from, width, rows);
    tensor.host().insert(tensor.host().end(), gathered.begin(), gathered.end());
    return;
  }
  const std::size_t before = tensor.size();
  tensor.resize(before + width * rows.size());
  cuda::gather_rows(from, width, rows, tensor.span().subspan(before), tensor.cuda().stream());
}

void append_rows(Array<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows) {
  check_tensor(tensor.size(), width);
  if (!tensor.is_cuda()) return append_rows_of(tensor, width, rows, tensor);
  const std::size_t before = tensor.size();
  tensor.resize(before + width * rows.size());  // may reallocate: the rows are read from the new buffer
  cuda::gather_rows(tensor.span().first(before), width, rows, tensor.span().subspan(before), tensor.cuda().stream());
}

void append_zero_rows(Array<float>& tensor, std::size_t width, std::size_t count) {
  check_tensor(tensor.size(), width);
  const std::size_t before = tensor.size(), after = before + width * count;
  if (!tensor.is_cuda()) return tensor.host().resize(after, 0.0f);
  tensor.resize(after);
  const std::span<float> added = tensor.span().subspan(before);
  tensor.cuda().stream().fill_zero(added.data(), added.size_bytes());
}

void remove_rows(std::vector<float>& tensor, std::size_t width, std::span<const std::uint8_t> removed) {
  check_tensor(tensor.size(), width);
  SPLATBOOST_CHECK(tensor.size() == width * removed.size(), "removed must have one byte per row");
  tensor = gathered_rows(tensor, width, kept_rows(removed));
}

}  // namespace splatboost
