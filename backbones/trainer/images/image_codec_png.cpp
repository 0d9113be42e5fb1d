// SPDX-License-Identifier: Apache-2.0
#include <png.h>

#include <bit>
#include <csetjmp>
#include <cstring>

#include "trainer/images/image_codec.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr int kPngCompression = 3;  // higher levels take much longer and save a few per cent
constexpr char kMagic[] = "\x89PNG\r\n\x1a\n";

constexpr char kPackInstead[] =
    "; this build has no OpenCV: pack the scene with 'splatboost pack' of a build with OpenCV";

struct Input {
  std::span<const std::uint8_t> file;
  std::size_t at = 0;
};

void read_input(png_structp png, png_bytep to, std::size_t bytes) {
  auto& input = *static_cast<Input*>(png_get_io_ptr(png));
  if (bytes > input.file.size() - input.at) png_error(png, "cut short");
  std::memcpy(to, input.file.data() + input.at, bytes);
  input.at += bytes;
}

void append_output(png_structp png, png_bytep from, std::size_t bytes) {
  auto& file = *static_cast<std::vector<std::uint8_t>*>(png_get_io_ptr(png));
  file.insert(file.end(), from, from + bytes);
}

void flush_output(png_structp) {}
void ignore_warning(png_structp, png_const_charp) {}
[[noreturn]] void return_to_caller(png_structp png, png_const_charp) { png_longjmp(png, 1); }  // prints nothing

/// On errors libpng jumps (longjmp) back here, skipping destructors: no local variable may need one.
bool read_png(png_structp png, png_infop info, Pixels& pixels, std::vector<png_bytep>& rows) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_read_info(png, info);
  png_set_expand(png);  // palettes to RGB, few bits to 8, a transparent colour to alpha
  if (std::endian::native == std::endian::little) png_set_swap(png);
  // Grey with alpha becomes RGBA, as OpenCV does.
  const bool alpha =
      (png_get_color_type(png, info) & PNG_COLOR_MASK_ALPHA) != 0 || png_get_valid(png, info, PNG_INFO_tRNS) != 0;
  if (alpha) png_set_gray_to_rgb(png);
  png_set_interlace_handling(png);
  png_read_update_info(png, info);
  pixels.width = static_cast<int>(png_get_image_width(png, info));
  pixels.height = static_cast<int>(png_get_image_height(png, info));
  pixels.channels = png_get_channels(png, info);
  pixels.bits = png_get_bit_depth(png, info);
  const std::size_t row = png_get_rowbytes(png, info);
  pixels.bytes.resize(row * static_cast<std::size_t>(pixels.height));
  rows.resize(static_cast<std::size_t>(pixels.height));
  for (std::size_t y = 0; y < rows.size(); ++y) rows[y] = pixels.bytes.data() + y * row;
  png_read_image(png, rows.data());
  return true;
}

bool write_png(png_structp png, png_infop info, const Pixels& pixels) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_compression_level(png, kPngCompression);
  const int type = pixels.channels == 1   ? PNG_COLOR_TYPE_GRAY
                   : pixels.channels == 3 ? PNG_COLOR_TYPE_RGB
                                          : PNG_COLOR_TYPE_RGBA;
  png_set_IHDR(png, info, static_cast<png_uint_32>(pixels.width), static_cast<png_uint_32>(pixels.height), pixels.bits,
               type, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, info);
  if (std::endian::native == std::endian::little) png_set_swap(png);
  const std::size_t row = pixels.bytes.size() / static_cast<std::size_t>(pixels.height);
  for (std::size_t y = 0; y < static_cast<std::size_t>(pixels.height); ++y) {
    png_write_row(png, pixels.bytes.data() + y * row);
  }
  png_write_end(png, info);
  return true;
}

}  // namespace

bool have_opencv() { return false; }
void set_opencv_threads(int) {}

Pixels decode_image(std::span<const std::uint8_t> file, const std::string& where) {
  require(file.size() > 8 && std::memcmp(file.data(), kMagic, 8) == 0,
          where + ": the image is not a PNG" + kPackInstead);
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, return_to_caller, ignore_warning);
  png_infop info = png_create_info_struct(png);
  Input input{file};
  png_set_read_fn(png, &input, read_input);
  Pixels pixels;
  std::vector<png_bytep> rows;
  const bool good = read_png(png, info, pixels, rows);
  png_destroy_read_struct(&png, &info, nullptr);
  require(good, where + ": the PNG cannot be decoded; copy it again");
  return pixels;
}

std::vector<std::uint8_t> encode_png(const Pixels& pixels, const std::string& where) {
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, return_to_caller, ignore_warning);
  png_infop info = png_create_info_struct(png);
  std::vector<std::uint8_t> file;
  png_set_write_fn(png, &file, append_output, flush_output);
  const bool good = write_png(png, info, pixels);
  png_destroy_write_struct(&png, &info);
  require(good, where + ": libpng cannot encode this image");
  return file;
}

Pixels shrink_image(const Pixels&, int, int, const std::string& where) {
  throw InputError(where + ": the image must be resized" + kPackInstead);
}

Pixels resample_image(const Pixels&, std::span<const float>, const std::string& where) {
  throw InputError(where + ": the image must be undistorted" + kPackInstead);
}

}  // namespace splatboost
