// SPDX-License-Identifier: Apache-2.0
/// @file Frequency encoding of net inputs: x, sin(2ᵏ·x) and cos(2ᵏ·x) (NeRF, Mildenhall et al. 2020, without π).
#pragma once

#include <cstddef>
#include <span>

namespace splatboost {

/// Columns of `width` encoded coordinates: the coordinates, then for k = 0 … frequencies − 1 their sines, then cosines.
constexpr std::size_t encoded_width(std::size_t width, std::size_t frequencies) {
  return width * (1 + 2 * frequencies);
}

/// Encodes rows of three coordinates. Real is float or double.
/// @param x [rows,3] @param encoded [rows,3·(1 + 2·frequencies)]
template <class Real>
void encode_positions(std::size_t rows, std::size_t frequencies, const Real* x, Real* encoded);

/// Encodes one number. @param encoded [1 + 2·frequencies]
template <class Real>
void encode_number(Real x, std::span<Real> encoded);

}  // namespace splatboost
