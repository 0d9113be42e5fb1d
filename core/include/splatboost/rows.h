// SPDX-License-Identifier: Apache-2.0
/// @file Row surgery: tensors follow the primitives when these are cloned, split and pruned.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "splatboost/array.h"
#include "splatboost/device_array.h"

namespace splatboost {

/// Keeps the rows whose mask byte is zero, in order. A tensor is values [rows, width], row-major.
void remove_rows(std::vector<float>& tensor, std::size_t width, std::span<const std::uint8_t> removed);

/// Appends copies of the given rows.
void append_rows(std::vector<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows);

/// Puts row order[i] at place i. @param order a permutation of the rows
void reorder_rows(std::vector<float>& tensor, std::size_t width, std::span<const std::uint32_t> order);

/// Appends `count` rows of zeros: the moments of new primitives.
void append_zero_rows(std::vector<float>& tensor, std::size_t width, std::size_t count);

// The same in the memory of a CUDA device, where the masks and the lists lie too. That their rows exist is not checked.

/// Waits for the device, to know how many rows are left.
void remove_rows(DeviceArray<float>& tensor, std::size_t width, std::span<const std::uint8_t> removed);
void append_rows(DeviceArray<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows);
void reorder_rows(DeviceArray<float>& tensor, std::size_t width, std::span<const std::uint32_t> order);
void append_zero_rows(DeviceArray<float>& tensor, std::size_t width, std::size_t count);

// The same of either device, which lists lie on too. None of these waits.

/// Leaves the rows that the list names, in its order: others go, or all get another place.
/// @param workspace of the device; what it holds means nothing, and nothing is allocated once it is large enough
void select_rows(Array<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows, Array<float>& workspace);
void append_rows(Array<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows);
void append_zero_rows(Array<float>& tensor, std::size_t width, std::size_t count);

/// Appends copies of rows of another tensor.
void append_rows_of(std::span<const float> from, std::size_t width, std::span<const std::uint32_t> rows,
                    Array<float>& tensor);

/// The rows whose mask byte is zero, in order: the list by which select_rows() removes the others.
std::vector<std::uint32_t> kept_rows(std::span<const std::uint8_t> removed);

}  // namespace splatboost
