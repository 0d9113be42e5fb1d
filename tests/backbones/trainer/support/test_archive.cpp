// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/archive.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "support/temporary_folder.h"
#include "trainer/support/input_error.h"

namespace splatboost::test {
namespace {

std::string error_of(const std::filesystem::path& path) {
  try {
    ArchiveReader archive(path);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

class Archive : public ::testing::Test {
 protected:
  void SetUp() override {
    ArchiveWriter writer;
    writer.put("floats", std::span<const float>(floats));
    writer.put("indices", std::span<const std::uint32_t>(indices));
    writer.put("nothing", std::span<const float>());
    writer.put("integer", std::int64_t{-1234567890123});
    writer.put("text", std::string_view("ä\0b", 4));
    writer.write(path);
  }

  TemporaryFolder folder;
  std::filesystem::path path = folder.path() / "a.ckpt";
  std::vector<float> floats = {1.5f, -0.0f, std::numeric_limits<float>::infinity(), std::nanf(""), 1e-42f};
  std::vector<std::uint32_t> indices = {0, 1, 0xffffffffu};
};

TEST_F(Archive, GivesBackWhatWasPut) {
  const ArchiveReader reader(path);
  const std::vector<float> read = reader.floats("floats");
  ASSERT_EQ(read.size(), floats.size());
  EXPECT_EQ(std::memcmp(read.data(), floats.data(), floats.size() * sizeof(float)), 0);
  EXPECT_EQ(reader.indices("indices"), indices);
  EXPECT_TRUE(reader.floats("nothing").empty());
  EXPECT_EQ(reader.integer("integer"), -1234567890123);
  EXPECT_EQ(reader.text("text"), std::string("ä\0b", 4));
}

TEST_F(Archive, LaterPutReplaces) {
  ArchiveWriter writer;
  writer.put("a", std::int64_t{1});
  writer.put("a", std::int64_t{2});
  writer.write(path);
  EXPECT_EQ(ArchiveReader(path).integer("a"), 2);
}

TEST_F(Archive, NamesFileAndEntryThatIsMissingOrOfAnotherType) {
  const ArchiveReader reader(path);
  for (const auto& [get, what] : std::vector<std::pair<std::function<void()>, std::string>>{
           {[&] { reader.floats("means"); }, "no entry 'means'"},
           {[&] { reader.floats("indices"); }, "'indices' has the wrong type"},
           {[&] { reader.indices("text"); }, "'text' has the wrong type"},
           {[&] { reader.integer("floats"); }, "'floats' has the wrong type"},
           {[&] { reader.text("integer"); }, "'integer' has the wrong type"}}) {
    try {
      get();
      ADD_FAILURE() << what;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(what), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find("a.ckpt"), std::string::npos) << error.what();
    }
  }
}

TEST_F(Archive, RefusesEveryTruncation) {
  const std::string whole = read_file(path);
  for (std::size_t length = 0; length < whole.size(); ++length) {
    write_file(path, whole.substr(0, length));
    EXPECT_NE(error_of(path).find("truncated"), std::string::npos) << length << ": " << error_of(path);
  }
}

TEST_F(Archive, RefusesWhatIsNoCheckpoint) {
  const std::string whole = read_file(path);
  write_file(path, "ply\nformat binary_little_endian 1.0\n");
  EXPECT_NE(error_of(path).find("not a checkpoint"), std::string::npos);
  write_file(path, whole + "x");
  EXPECT_NE(error_of(path).find("damaged"), std::string::npos);
  std::string newer = whole;
  newer[7] = '3';
  write_file(path, newer);
  EXPECT_NE(error_of(path).find("version 03"), std::string::npos);
  std::string older = whole;
  older[7] = '1';
  write_file(path, older);
  EXPECT_NE(error_of(path).find("version 01, this program reads 02; use the version"), std::string::npos);
  EXPECT_NE(error_of(folder.path() / "none.ckpt").find("no such checkpoint"), std::string::npos);
  EXPECT_NE(error_of(folder.path()).find("no such checkpoint"), std::string::npos);
}

TEST_F(Archive, RefusesEveryChangedBit) {
  // A wrong length must not cause a huge allocation or a read past the end.
  const std::string whole = read_file(path);
  for (std::size_t i = 0; i < 8 * whole.size(); ++i) {
    std::string changed = whole;
    changed[i / 8] = static_cast<char>(changed[i / 8] ^ (1 << i % 8));
    write_file(path, changed);
    EXPECT_NE(error_of(path), "") << "bit " << i;
  }
}

TEST_F(Archive, RefusesExchangedBytes) {
  const std::string whole = read_file(path);
  for (std::size_t i = 0; i + 1 < whole.size(); ++i) {
    if (whole[i] == whole[i + 1]) continue;
    std::string changed = whole;
    std::swap(changed[i], changed[i + 1]);
    write_file(path, changed);
    EXPECT_NE(error_of(path), "") << "bytes from " << i;
  }
}

}  // namespace
}  // namespace splatboost::test
