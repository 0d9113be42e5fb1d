// SPDX-License-Identifier: Apache-2.0
/// @file Row operations that keep tensors in step with primitives that are cloned, split and pruned.
///
/// A tensor is values [rows, width], row-major; lists of rows are on the same device. Row indices are checked on the
/// CPU only. None of these operations waits for a GPU.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "splatboost/array.h"

namespace splatboost {

/// The rows whose mask byte is zero, in order: with this list select_rows() removes the others.
std::vector<std::uint32_t> kept_rows(std::span<const std::uint8_t> removed);

/// Whether each row is greater than the one before it, as in a list of kept_rows().
bool rows_ascend(std::span<const std::uint32_t> rows);

/// Replaces the tensor by the listed rows, in the order of the list: removes or reorders rows.
/// @param workspace on the same device; its values are arbitrary. Once it is large enough nothing is allocated. On the
/// CPU it is not needed if the rows ascend: they are then moved in place
void select_rows(Array<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows, Array<float>& workspace);

/// Appends copies of rows of another tensor.
void append_rows_of(std::span<const float> from, std::size_t width, std::span<const std::uint32_t> rows,
                    Array<float>& tensor);

/// Appends copies of the tensor's own rows.
void append_rows(Array<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows);

/// Appends `count` rows of zeros, e.g. Adam moments of new primitives.
void append_zero_rows(Array<float>& tensor, std::size_t width, std::size_t count);

/// Keeps the rows whose mask byte is zero, in order, of a tensor in host memory.
void remove_rows(std::vector<float>& tensor, std::size_t width, std::span<const std::uint8_t> removed);

}  // namespace splatboost
