// SPDX-License-Identifier: Apache-2.0
/// @file Image files and resampling, by OpenCV. A build without it has libpng: it reads and writes PNG files, and
/// resamples nothing.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace splatboost {

/// Interleaved pixels, channels in the order R, G, B, A (or one of grey); 16-bit ones in the machine's byte order.
struct Pixels {
  int width = 0;
  int height = 0;
  int channels = 0;
  int bits = 8;  ///< 8 or 16
  std::vector<std::uint8_t> bytes;
};

/// Whether this build has OpenCV.
bool have_opencv();

/// An image file as it is stored: no rotation by EXIF, since COLMAP did not rotate either; alpha and 16 bit kept.
/// Throws InputError, beginning with `where`.
Pixels decode_image(std::span<const std::uint8_t> file, const std::string& where);

/// The bytes of a PNG file. Throws InputError, beginning with `where`.
/// @param pixels 1 (grey), 3 (RGB) or 4 (RGBA) channels of 8 or 16 bits
std::vector<std::uint8_t> encode_png(const Pixels& pixels, const std::string& where);

/// 8-bit pixels at a smaller size, by the means over areas. Throws InputError, beginning with `where`.
Pixels shrink_image(const Pixels& pixels, int width, int height, const std::string& where);

/// 8-bit pixels resampled linearly; beyond the border its pixels go on. Throws InputError, beginning with `where`.
/// @param positions [H,W,2] x, y of each result's source, counted from the middle of the first pixel
Pixels resample_image(const Pixels& pixels, std::span<const float> positions, const std::string& where);

}  // namespace splatboost
