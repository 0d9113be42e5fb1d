// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/archive.h"

#include <bit>
#include <cstring>
#include <fstream>
#include <utility>

#include "trainer/support/atomic_file.h"
#include "trainer/support/checksum.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

// File layout, little endian: magic; number of entries (u32); for each entry the length of its name (u32), the name,
// the length of its content (u64) and the content; at the end the checksum (u64) of all of that, chained from field to
// field. The first byte of a content is its type, so that reading an entry as another type is detected.
constexpr char kMagic[8] = {'S', 'B', 'C', 'K', 'P', 'T', '0', '2'};
constexpr std::size_t kVersionDigits = 2;
constexpr std::uint32_t kMaxName = 4096;
constexpr char kTypeFloats = 'f';
constexpr char kTypeIndices = 'u';
constexpr char kTypeInteger = 'i';
constexpr char kTypeText = 't';

static_assert(std::endian::native == std::endian::little,
              "checkpoints hold little-endian numbers as they lie in memory");

std::vector<std::byte> tagged(char type, const void* data, std::size_t bytes) {
  std::vector<std::byte> content(1 + bytes);
  content[0] = static_cast<std::byte>(type);
  if (bytes > 0) std::memcpy(content.data() + 1, data, bytes);
  return content;
}

/// Writes blocks and, in end(), their checksum.
class CheckedOutput {
 public:
  explicit CheckedOutput(std::ostream& stream) : stream_(stream) {}

  void write(std::span<const std::byte> bytes) {
    stream_.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    sum_ = checksum(bytes, sum_);
  }
  void write(std::string_view text) { write(std::as_bytes(std::span(text))); }

  template <class T>
  void number(T value) {
    write(std::as_bytes(std::span(&value, 1)));
  }

  void end() { number(sum_); }

 private:
  std::ostream& stream_;
  std::uint64_t sum_ = 0;
};

/// Reads from a file of known size; a read past its end throws before anything is allocated.
class BoundedInput {
 public:
  BoundedInput(const std::filesystem::path& path, std::ifstream& stream, std::uint64_t size)
      : path_(path), stream_(stream), left_(size) {}

  template <class T>
  T number() {
    T value{};
    read(&value, sizeof value);
    return value;
  }

  void read(void* target, std::uint64_t bytes) {
    require(bytes);
    stream_.read(static_cast<char*>(target), static_cast<std::streamsize>(bytes));
    if (!stream_) fail("cannot be read");
    left_ -= bytes;
    sum_ = checksum({static_cast<const std::byte*>(target), bytes}, sum_);
  }

  /// Reads the checksum of everything before it; the file must end there.
  void end() {
    const std::uint64_t sum = sum_;
    if (number<std::uint64_t>() != sum) fail("is damaged: its checksum does not match; copy it again");
    if (left_ != 0) fail("is damaged: bytes follow its end");
  }

  void require(std::uint64_t bytes) const {
    if (bytes > left_) fail("is truncated");
  }

  [[noreturn]] void fail(const std::string& what) const { throw InputError(path_.string() + ": " + what); }

 private:
  const std::filesystem::path& path_;
  std::ifstream& stream_;
  std::uint64_t left_;
  std::uint64_t sum_ = 0;
};

template <class T>
std::vector<T> numbers(std::span<const std::byte> bytes, const std::filesystem::path& path, std::string_view name) {
  if (bytes.size() % sizeof(T) != 0) {
    throw InputError(path.string() + ": entry '" + std::string(name) + "' is incomplete");
  }
  std::vector<T> values(bytes.size() / sizeof(T));
  if (!values.empty()) std::memcpy(values.data(), bytes.data(), bytes.size());
  return values;
}

void require_type(std::span<const std::byte> content, char type, const std::filesystem::path& path,
                  std::string_view name) {
  if (static_cast<char>(content[0]) != type) {
    throw InputError(path.string() + ": entry '" + std::string(name) + "' has the wrong type");
  }
}

}  // namespace

void ArchiveWriter::put(std::string_view name, std::span<const float> values) {
  entries_.insert_or_assign(std::string(name), tagged(kTypeFloats, values.data(), values.size_bytes()));
}

void ArchiveWriter::put(std::string_view name, std::span<const std::uint32_t> values) {
  entries_.insert_or_assign(std::string(name), tagged(kTypeIndices, values.data(), values.size_bytes()));
}

void ArchiveWriter::put(std::string_view name, std::int64_t value) {
  entries_.insert_or_assign(std::string(name), tagged(kTypeInteger, &value, sizeof value));
}

void ArchiveWriter::put(std::string_view name, std::string_view text) {
  entries_.insert_or_assign(std::string(name), tagged(kTypeText, text.data(), text.size()));
}

void ArchiveWriter::write(const std::filesystem::path& path) const {
  write_file_atomically(path, [this](std::ostream& stream) {
    CheckedOutput output(stream);
    output.write(std::string_view(kMagic, sizeof kMagic));
    output.number(static_cast<std::uint32_t>(entries_.size()));
    for (const auto& [name, content] : entries_) {
      output.number(static_cast<std::uint32_t>(name.size()));
      output.write(name);
      output.number(static_cast<std::uint64_t>(content.size()));
      output.write(content);
    }
    output.end();
  });
}

ArchiveReader::ArchiveReader(std::filesystem::path path) : path_(std::move(path)) {
  std::error_code error;
  const std::uint64_t size =
      std::filesystem::is_regular_file(path_, error) ? std::filesystem::file_size(path_, error) : 0;
  std::ifstream stream(path_, std::ios::binary);
  if (error || !stream || !std::filesystem::is_regular_file(path_, error)) {
    throw InputError(path_.string() + ": no such checkpoint, or it cannot be opened");
  }
  BoundedInput input(path_, stream, size);
  char magic[sizeof kMagic] = {};
  if (size < sizeof magic) input.fail("is truncated or was not written by SplatBoost");
  input.read(magic, sizeof magic);
  if (std::memcmp(magic, kMagic, sizeof magic - kVersionDigits) != 0) {
    throw InputError(path_.string() + ": not a checkpoint or model file of SplatBoost");
  }
  if (std::memcmp(magic, kMagic, sizeof magic) != 0) {
    input.fail("has format version " + std::string(magic + sizeof magic - kVersionDigits, kVersionDigits) +
               ", this program reads " + std::string(kMagic + sizeof kMagic - kVersionDigits, kVersionDigits) +
               "; use the version of SplatBoost that wrote it, or train again");
  }
  const auto count = input.number<std::uint32_t>();
  for (std::uint32_t i = 0; i < count; ++i) {
    const auto name_length = input.number<std::uint32_t>();
    if (name_length == 0 || name_length > kMaxName) input.fail("is damaged: invalid length of a name");
    input.require(name_length);
    std::string name(name_length, '\0');
    input.read(name.data(), name.size());
    const auto length = input.number<std::uint64_t>();
    if (length == 0) input.fail("is damaged: entry '" + name + "' is empty");
    input.require(length);
    std::vector<std::byte> content(length);
    input.read(content.data(), length);
    if (!entries_.emplace(name, std::move(content)).second) input.fail("is damaged: entry '" + name + "' occurs twice");
  }
  input.end();
}

std::span<const std::byte> ArchiveReader::entry(std::string_view name) const {
  const auto found = entries_.find(name);
  if (found == entries_.end()) {
    throw InputError(path_.string() + ": has no entry '" + std::string(name) +
                     "': it is of another backbone or version");
  }
  return found->second;
}

std::vector<float> ArchiveReader::floats(std::string_view name) const {
  const auto content = entry(name);
  require_type(content, kTypeFloats, path_, name);
  return numbers<float>(content.subspan(1), path_, name);
}

std::vector<std::uint32_t> ArchiveReader::indices(std::string_view name) const {
  const auto content = entry(name);
  require_type(content, kTypeIndices, path_, name);
  return numbers<std::uint32_t>(content.subspan(1), path_, name);
}

std::int64_t ArchiveReader::integer(std::string_view name) const {
  const auto content = entry(name);
  require_type(content, kTypeInteger, path_, name);
  const auto values = numbers<std::int64_t>(content.subspan(1), path_, name);
  if (values.size() != 1) throw InputError(path_.string() + ": entry '" + std::string(name) + "' is incomplete");
  return values[0];
}

std::string ArchiveReader::text(std::string_view name) const {
  const auto content = entry(name);
  require_type(content, kTypeText, path_, name);
  const auto bytes = content.subspan(1);
  return std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size());
}

}  // namespace splatboost
