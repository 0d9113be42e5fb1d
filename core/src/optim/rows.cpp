// SPDX-License-Identifier: Apache-2.0
#include "splatboost/rows.h"

#include <algorithm>
#include <cstring>
#include <functional>

#include "optim/cuda_ops.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

void check_tensor(std::size_t size, std::size_t width) {
  SPLATBOOST_CHECK(width > 0, "width must be above 0");
  SPLATBOOST_CHECK(size % width == 0, "tensor must contain whole rows of the given width");
}

void check_rows(std::size_t size, std::size_t width, std::span<const std::uint32_t> rows) {
  for (const std::size_t row : rows) {
    SPLATBOOST_CHECK(width * (row + 1) <= size, "rows must contain existing row numbers");
  }
}

/// `to` may be the tensor itself if the rows ascend: none is overwritten before it has been copied.
void gather(std::span<const float> from, std::size_t width, std::span<const std::uint32_t> rows, float* to) {
  for (const std::size_t row : rows) {
    std::memmove(to, from.data() + width * row, width * sizeof(float));
    to += width;
  }
}

/// Keeps the size of a workspace that is large enough: to shrink it and let it grow again would fill it with zeros.
std::span<float> workspace_of(Array<float>& workspace, std::size_t n) {
  if (workspace.size() < n) workspace.ensure(n);
  return workspace.span().first(n);
}

}  // namespace

bool rows_ascend(std::span<const std::uint32_t> rows) {
  return std::adjacent_find(rows.begin(), rows.end(), std::greater_equal<>()) == rows.end();
}

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
  const std::size_t selected = width * rows.size();
  if (!tensor.is_cuda()) {
    check_rows(tensor.size(), width, rows);
    std::vector<float>& values = tensor.host();
    if (rows_ascend(rows)) {
      gather(values, width, rows, values.data());
      return values.resize(selected);
    }
    const std::span<float> there = workspace_of(workspace, selected);
    gather(values, width, rows, there.data());
    return values.assign(there.begin(), there.end());
  }
  const std::span<float> there = workspace_of(workspace, selected);
  cuda::gather_rows(tensor, width, rows, there, tensor.cuda().stream());
  tensor.ensure(selected);
  tensor.cuda().stream().copy_on_device(tensor.span().data(), there.data(), there.size_bytes());
}

void append_rows_of(std::span<const float> from, std::size_t width, std::span<const std::uint32_t> rows,
                    Array<float>& tensor) {
  check_tensor(from.size(), width);
  if (!tensor.is_cuda()) {
    check_rows(from.size(), width, rows);
    std::vector<float> gathered(width * rows.size());  // `from` may be the tensor, whose memory moves as it grows
    gather(from, width, rows, gathered.data());
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
  const std::vector<std::uint32_t> kept = kept_rows(removed);
  gather(tensor, width, kept, tensor.data());
  tensor.resize(width * kept.size());
}

}  // namespace splatboost
