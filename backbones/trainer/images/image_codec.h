// SPDX-License-Identifier: Apache-2.0
/// @file Image files and resampling, with OpenCV. A build without OpenCV uses libpng: it reads and writes only PNG
/// files, and cannot resample.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace splatboost {

/// Interleaved pixels [H,W,channels] in the order R, G, B, A (or grey alone); 16-bit values in native byte order.
struct Pixels {
  int width = 0;
  int height = 0;
  int channels = 0;
  int bits = 8;  ///< 8 or 16
  std::vector<std::uint8_t> bytes;
};

/// Whether this build has OpenCV.
bool have_opencv();

/// Sets the number of threads of OpenCV's own loops, for the whole process; `count` is at least 1 and limited to
/// available_cpus(). Images and tracking are the same for any number; LPIPS changes by rounding, about 1e-8 of it.
void set_opencv_threads(int count);

/// Decodes an image file without conversion: alpha and 16 bit are kept, and the EXIF orientation is ignored, as COLMAP
/// does. Throws InputError, beginning with `where`.
Pixels decode_image(std::span<const std::uint8_t> file, const std::string& where);

/// The bytes of a PNG file. Throws InputError, beginning with `where`.
/// @param pixels 1 (grey), 3 (RGB) or 4 (RGBA) channels of 8 or 16 bits
std::vector<std::uint8_t> encode_png(const Pixels& pixels, const std::string& where);

/// Downsamples 8-bit pixels by area averaging. Throws InputError, beginning with `where`.
Pixels shrink_image(const Pixels& pixels, int width, int height, const std::string& where);

/// Downsamples a mask of one channel, 255: valid. A pixel is valid (255, else 0) if all pixels averaged into it are.
/// Throws InputError, beginning with `where`.
inline Pixels shrink_mask(const Pixels& mask, int width, int height, const std::string& where) {
  Pixels shrunk = shrink_image(mask, width, height, where);
  for (std::uint8_t& value : shrunk.bytes) value = value == 255 ? 255 : 0;
  return shrunk;
}

/// A mask of one channel: 255 where a pixel of the image is not black, whatever its alpha.
inline Pixels mask_of_picture(const Pixels& image) {
  const auto value = static_cast<std::size_t>(image.bits / 8), pixel = value * static_cast<std::size_t>(image.channels);
  const std::size_t colors = image.channels == 4 ? 3 * value : pixel;
  Pixels mask{image.width, image.height, 1, 8, std::vector<std::uint8_t>(image.bytes.size() / pixel)};
  for (std::size_t p = 0; p < mask.bytes.size(); ++p) {
    const std::uint8_t* from = image.bytes.data() + p * pixel;
    mask.bytes[p] = std::any_of(from, from + colors, [](std::uint8_t byte) { return byte != 0; }) ? 255 : 0;
  }
  return mask;
}

/// Resamples 8-bit pixels bilinearly, replicating the border. Throws InputError, beginning with `where`.
/// @param positions [H,W,2] source position x, y of each result pixel, measured from the centre of the first pixel
Pixels resample_image(const Pixels& pixels, std::span<const float> positions, const std::string& where);

}  // namespace splatboost
