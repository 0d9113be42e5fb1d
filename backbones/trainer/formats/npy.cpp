// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/npy.h"

#include <charconv>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <string>
#include <string_view>

#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr std::string_view kMagic = "\x93NUMPY";
constexpr std::size_t kMaxBytes = std::size_t{1} << 33;

/// The text after 'key': in the header, which is a Python dictionary.
std::string_view value_of(std::string_view header, std::string_view key) {
  const std::size_t at = header.find("'" + std::string(key) + "'");
  if (at == std::string_view::npos) return {};
  std::string_view rest = header.substr(at + key.size() + 2);
  rest.remove_prefix(std::min(rest.find_first_not_of(": "), rest.size()));
  return rest;
}

}  // namespace

NpyArray read_npy(const std::filesystem::path& file, std::size_t most_dimensions) {
  const auto fail = [&](const std::string& cause) { throw InputError(file.string() + ": " + cause); };
  std::error_code error;
  const std::uint64_t size = std::filesystem::file_size(file, error);
  if (error) fail("cannot be read: " + error.message());
  if (size > kMaxBytes) fail("is too large for an array of cameras or points");
  std::string bytes(size, '\0');
  std::ifstream in(file, std::ios::binary);
  in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  if (!in) fail("cannot be read; check its permissions");

  const auto byte = [&](std::size_t i) { return static_cast<std::size_t>(static_cast<unsigned char>(bytes[i])); };
  if (size < 12 || !bytes.starts_with(kMagic)) fail("is not a NumPy array file (.npy)");
  const bool long_header = byte(6) >= 2;  // version
  const std::size_t begin = long_header ? 12 : 10;
  std::size_t length = byte(8) | byte(9) << 8;
  if (long_header) length |= byte(10) << 16 | byte(11) << 24;
  if (length > size - begin) fail("is cut short; copy it again");
  const std::string_view header = std::string_view(bytes).substr(begin, length);

  const std::string_view type = value_of(header, "descr");
  const bool single = type.starts_with("'<f4'");
  if (!single && !type.starts_with("'<f8'")) fail("does not contain 32- or 64-bit floats");
  if (!value_of(header, "fortran_order").starts_with("False"))
    fail("is in column-major order (fortran_order), which is not supported");

  NpyArray array;
  std::string_view shape = value_of(header, "shape");
  if (!shape.starts_with("(")) fail("has no shape");
  shape.remove_prefix(1);
  std::size_t count = 1;
  while (true) {
    shape.remove_prefix(std::min(shape.find_first_not_of(", "), shape.size()));
    if (shape.starts_with(")")) break;
    std::size_t side = 0;
    const auto parsed = std::from_chars(shape.data(), shape.data() + shape.size(), side);
    if (parsed.ec != std::errc{}) fail("has a shape that cannot be read");
    if (side > kMaxBytes || (side != 0 && count > kMaxBytes / side)) fail("has a shape that is out of range");
    count *= side;
    array.shape.push_back(side);
    shape.remove_prefix(static_cast<std::size_t>(parsed.ptr - shape.data()));
  }
  if (array.shape.size() > most_dimensions) {
    fail("has " + std::to_string(array.shape.size()) + " dimensions, at most " + std::to_string(most_dimensions) +
         " are expected");
  }
  const std::size_t width = single ? 4 : 8, first = begin + length;
  if ((size - first) / width < count) fail("is cut short; copy it again");
  array.values.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    if (single) {
      float value = 0;
      std::memcpy(&value, bytes.data() + first + width * i, width);
      array.values[i] = static_cast<double>(value);
    } else {
      std::memcpy(&array.values[i], bytes.data() + first + width * i, width);
    }
  }
  return array;
}

}  // namespace splatboost
