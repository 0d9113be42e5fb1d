// SPDX-License-Identifier: Apache-2.0
#include "trainer/dataset/picture_size.h"

#include "trainer/images/image_damage.h"

namespace splatboost {
namespace {

/// A big-endian number of `count` bytes, at most 4; 0 if the file ends before it, or if it exceeds the range of int.
int number_at(std::span<const std::uint8_t> file, std::size_t at, std::size_t count) {
  if (at + count > file.size()) return 0;
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < count; ++i) value = value << 8 | file[at + i];
  return value <= 0x7fffffff ? static_cast<int>(value) : 0;
}

std::optional<ImageSize> known(ImageSize size) {
  return size.width > 0 && size.height > 0 ? std::optional(size) : std::nullopt;
}

/// The header of the first frame (SOF) of a JPEG.
std::optional<ImageSize> size_in_jpeg(std::span<const std::uint8_t> file) {
  for (std::size_t at = 2; at + 4 <= file.size();) {
    const std::uint8_t marker = file[at + 1];
    if (file[at] != 0xff || marker == 0xda) return std::nullopt;  // no marker, or the pixels begin
    if (marker == 0xff) {                                         // fill byte
      ++at;
      continue;
    }
    const bool other_table = marker == 0xc4 || marker == 0xc8 || marker == 0xcc;  // DHT, JPG, DAC
    if (marker >= 0xc0 && marker <= 0xcf && !other_table) {
      return known({number_at(file, at + 7, 2), number_at(file, at + 5, 2)});
    }
    at += 2 + static_cast<std::size_t>(number_at(file, at + 2, 2));
  }
  return std::nullopt;
}

}  // namespace

std::optional<ImageSize> size_in_header(std::span<const std::uint8_t> file) {
  if (has_magic(file, "\x89PNG\r\n\x1a\n")) return known({number_at(file, 16, 4), number_at(file, 20, 4)});
  if (has_magic(file, "\xff\xd8\xff")) return size_in_jpeg(file);
  return std::nullopt;
}

}  // namespace splatboost
