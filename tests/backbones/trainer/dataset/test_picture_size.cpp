// SPDX-License-Identifier: Apache-2.0
#include "trainer/dataset/picture_size.h"

#include <gtest/gtest.h>

#include <string>

#include "support/temporary_folder.h"
#include "trainer/dataset/view_image.h"

namespace splatboost::test {
namespace {

std::optional<ImageSize> size_of(const std::string& file) {
  return size_in_header({reinterpret_cast<const std::uint8_t*>(file.data()), file.size()});
}

std::string big_endian(std::uint32_t value, int bytes) {
  std::string text;
  for (int i = bytes - 1; i >= 0; --i) text += static_cast<char>(value >> (8 * i));
  return text;
}

/// The checksum of a PNG's chunk.
std::uint32_t crc_of(const std::string& chunk) {
  std::uint32_t crc = 0xffffffff;
  for (const char byte : chunk) {
    crc ^= static_cast<std::uint8_t>(byte);
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 1) != 0 ? 0xedb88320u ^ (crc >> 1) : crc >> 1;
  }
  return ~crc;
}

std::string png_chunk(const std::string& name, const std::string& content) {
  return big_endian(static_cast<std::uint32_t>(content.size()), 4) + name + content +
         big_endian(crc_of(name + content), 4);
}

/// A PNG without pixels, whose header states a size.
std::string png_of(std::uint32_t width, std::uint32_t height) {
  const std::string header = big_endian(width, 4) + big_endian(height, 4) + std::string("\x08\x00\x00\x00\x00", 5);
  return "\x89PNG\r\n\x1a\n" + png_chunk("IHDR", header) + png_chunk("IDAT", "") + png_chunk("IEND", "");
}

/// A JPEG without pixels: JFIF and Huffman tables, a fill byte, then the header of a frame.
std::string jpeg_of(std::uint32_t width, std::uint32_t height, char frame) {
  const auto segment = [](const std::string& marker, const std::string& content) {
    return marker + big_endian(static_cast<std::uint32_t>(content.size() + 2), 2) + content;
  };
  return "\xff\xd8" + segment("\xff\xe0", std::string(14, '\xc0')) + segment("\xff\xc4", std::string(30, '\xff')) +
         segment(std::string("\xff\xff") + frame, '\x08' + big_endian(height, 2) + big_endian(width, 2) + "\x01") +
         segment("\xff\xda", "") + "\xff\xd9";
}

TEST(PictureSize, IsThatOfTheHeader) {
  EXPECT_EQ(size_of(png_of(20000, 15000)), (ImageSize{20000, 15000}));
  for (const char frame : {'\xc0', '\xc1', '\xc2'}) EXPECT_EQ(size_of(jpeg_of(300, 200, frame)), (ImageSize{300, 200}));
  EXPECT_EQ(size_of(jpeg_of(300, 0, '\xc0')), std::nullopt) << "the height follows the pixels";
  EXPECT_EQ(size_of(png_of(0xffffffff, 4)), std::nullopt);
  EXPECT_EQ(size_of("BM"), std::nullopt);
  for (const std::string& whole : {png_of(7, 5), jpeg_of(7, 5, '\xc2')}) {
    for (std::size_t bytes = 0; bytes <= whole.size(); ++bytes) {
      const auto size = size_of(whole.substr(0, bytes));
      EXPECT_TRUE(!size || *size == (ImageSize{7, 5})) << bytes;
    }
  }
}

TEST(PictureSize, IsComparedWithTheCameraBeforeDecoding) {
  const TemporaryFolder folder;
  Photo photo;
  photo.file = folder / "a.png";
  photo.listed_in = folder / "cameras.bin";
  photo.lens.width = 96;
  photo.lens.height = 60;
  photo.lens.fx = photo.lens.fy = 80;
  write_file(photo.file, png_of(20000, 15000));  // without pixels: decoding would be another error
  expect_contains(input_error_of([&] { load_view(photo, {}); }), "a.png: is 20000x15000, but its camera in ");
  write_file(photo.file, jpeg_of(2000, 1500, '\xc0'));
  expect_contains(input_error_of([&] { load_view(photo, {}); }), "a.png: is 2000x1500, but its camera in ");
}

}  // namespace
}  // namespace splatboost::test
