// SPDX-License-Identifier: Apache-2.0
/// @file Row surgery: tensors follow the primitives when these are cloned, split and pruned.
///
/// A tensor is values [rows, width], row-major, with the lists of rows on the same device. That the rows of a list
/// exist is checked on the CPU only. None of these waits for a GPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "splatboost/array.h"

namespace splatboost {

/// The rows whose mask byte is zero, in order: the list by which select_rows() removes the others.
std::vector<std::uint32_t> kept_rows(std::span<const std::uint8_t> removed);

/// Leaves the rows that the list names, in its order: others go, or all get another place.
/// @param workspace of the device; what it holds means nothing, and nothing is allocated once it is large enough
void select_rows(Array<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows, Array<float>& workspace);

/// Appends copies of rows of another tensor.
void append_rows_of(std::span<const float> from, std::size_t width, std::span<const std::uint32_t> rows,
                    Array<float>& tensor);

/// Appends copies of the tensor's own rows.
void append_rows(Array<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows);

/// Appends `count` rows of zeros: the moments of new primitives.
void append_zero_rows(Array<float>& tensor, std::size_t width, std::size_t count);

/// Keeps the rows whose mask byte is zero, in order, of a tensor that never leaves the host.
void remove_rows(std::vector<float>& tensor, std::size_t width, std::span<const std::uint8_t> removed);

}  // namespace splatboost
