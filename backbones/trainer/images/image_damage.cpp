// SPDX-License-Identifier: Apache-2.0
#include "trainer/images/image_damage.h"

#include <algorithm>
#include <array>

#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

[[noreturn]] void fail(const std::string& where, const std::string& cause) { throw InputError(where + ": " + cause); }

std::uint32_t big_endian_32(std::span<const std::uint8_t> bytes, std::size_t at) {
  return std::uint32_t{bytes[at]} << 24 | std::uint32_t{bytes[at + 1]} << 16 | std::uint32_t{bytes[at + 2]} << 8 |
         std::uint32_t{bytes[at + 3]};
}

constexpr std::array<std::uint32_t, 256> make_crc_table() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t value = i;
    for (int bit = 0; bit < 8; ++bit) value = (value & 1) != 0 ? 0xedb88320u ^ (value >> 1) : value >> 1;
    table[i] = value;
  }
  return table;
}

std::uint32_t crc32(std::span<const std::uint8_t> bytes) {
  static constexpr std::array<std::uint32_t, 256> kTable = make_crc_table();
  std::uint32_t crc = 0xffffffffu;
  for (const std::uint8_t byte : bytes) crc = kTable[(crc ^ byte) & 0xff] ^ (crc >> 8);
  return ~crc;
}

/// Checks the chunks of a PNG. libpng detects damage as well, but reports it on stderr.
void check_png(std::span<const std::uint8_t> bytes, const std::string& where) {
  for (std::size_t at = 8;;) {
    if (bytes.size() - at < 12) fail(where, "the PNG is cut short; copy it again");
    const std::size_t length = big_endian_32(bytes, at);
    if (length > bytes.size() - at - 12) fail(where, "the PNG is cut short; copy it again");
    const auto checked = bytes.subspan(at + 4, length + 4);
    if (crc32(checked) != big_endian_32(bytes, at + 8 + length)) {
      fail(where, "the PNG is damaged (a checksum does not match); copy it again");
    }
    if (has_magic(checked, "IEND")) return;
    at += 12 + length;
  }
}

/// Looks for the end marker of a JPEG after the start of its first scan. libjpeg fills a truncated image with grey,
/// warns on stderr and reports success; training on that would be a silent error.
void check_jpeg(std::span<const std::uint8_t> bytes, const std::string& where) {
  std::size_t at = 2;
  while (at + 4 <= bytes.size()) {
    if (bytes[at] != 0xff) return;  // not a marker: the decoder decides
    const std::uint8_t marker = bytes[at + 1];
    if (marker == 0xff) {  // fill byte
      ++at;
      continue;
    }
    if (marker == 0xda) {  // start of scan: inside it, 0xff is always followed by 0 or a marker
      for (std::size_t i = at + 2; i + 1 < bytes.size(); ++i) {
        if (bytes[i] == 0xff && bytes[i + 1] == 0xd9) return;
      }
      break;
    }
    at += 2 + (std::size_t{bytes[at + 2]} << 8 | bytes[at + 3]);
  }
  fail(where, "the JPEG is cut short; copy it again");
}

/// Compares a BMP with the size in its header. OpenCV detects truncation as well, but reports it on stderr.
void check_bmp(std::span<const std::uint8_t> bytes, const std::string& where) {
  constexpr std::size_t kHeader = 54;
  const bool complete = bytes.size() >= kHeader && (std::size_t{bytes[5]} << 24 | std::size_t{bytes[4]} << 16 |
                                                    std::size_t{bytes[3]} << 8 | bytes[2]) <= bytes.size();
  if (!complete) fail(where, "the BMP is cut short or damaged; copy it again");
}

}  // namespace

bool has_magic(std::span<const std::uint8_t> file, std::string_view magic) {
  return file.size() >= magic.size() &&
         std::equal(magic.begin(), magic.end(), file.begin(),
                    [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
}

void require_whole_image(std::span<const std::uint8_t> file, const std::string& where) {
  if (file.empty()) fail(where, "the image is empty (0 bytes); copy it again");
  if (has_magic(file, "\x89PNG\r\n\x1a\n")) check_png(file, where);
  if (has_magic(file, "\xff\xd8\xff")) check_jpeg(file, where);
  if (has_magic(file, "BM")) check_bmp(file, where);
}

}  // namespace splatboost
