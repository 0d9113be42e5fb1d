// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/packed_scene.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <fstream>
#include <ostream>
#include <span>
#include <string_view>
#include <utility>

#include <glm/gtc/type_ptr.hpp>
#include <nlohmann/json.hpp>

#include "splatboost/errors.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/checksum.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_values.h"

namespace splatboost {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

// File: magic, then blocks, each followed by its checksum: the listing's length (u64), the listing (JSON), positions
// and colours of the points, the same for each few-view cloud, and for each photo its colours, its colours over white
// and its mask, the last two only if the listing says so. Little endian.
constexpr std::string_view kMagic = "SBSCEN01";
constexpr std::size_t kVersionDigits = 2;
constexpr std::size_t kChecksum = sizeof(std::uint64_t);
constexpr int kLargestSide = 1 << 20;

static_assert(std::endian::native == std::endian::little, "packed scenes hold numbers as they lie in memory");

template <class T>
std::span<const std::byte> bytes_of(const std::vector<T>& values) {
  return std::as_bytes(std::span(values));
}

void write_block(std::ostream& stream, std::span<const std::byte> bytes) {
  stream.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  const std::uint64_t sum = checksum(bytes);
  stream.write(reinterpret_cast<const char*>(&sum), sizeof sum);
}

std::uint64_t block_bytes(std::uint64_t content) { return content + kChecksum; }
std::uint64_t cloud_bytes(std::uint64_t points) { return block_bytes(12 * points) + block_bytes(3 * points); }

std::uint64_t photo_bytes(const PackedPhoto& photo) {
  const auto pixels =
      static_cast<std::uint64_t>(photo.view.camera.width) * static_cast<std::uint64_t>(photo.view.camera.height);
  return block_bytes(3 * pixels) * (photo.transparent ? 2 : 1) + (photo.masked ? block_bytes(pixels) : 0);
}

/// Reads blocks one after the other.
class BlockReader {
 public:
  BlockReader(const fs::path& path, std::uint64_t at) : path_(path), stream_(path, std::ios::binary) {
    stream_.seekg(static_cast<std::streamoff>(at));
    if (!stream_) throw InputError(path_.string() + ": cannot be read; check its permissions");
  }

  template <class T>
  std::vector<T> block(std::uint64_t count) {
    std::vector<T> values(count);
    fill(std::as_writable_bytes(std::span(values)));
    return values;
  }

  void skip(std::uint64_t content) { stream_.seekg(static_cast<std::streamoff>(block_bytes(content)), std::ios::cur); }

 private:
  void fill(std::span<std::byte> bytes) {
    std::uint64_t sum = 0;
    stream_.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    stream_.read(reinterpret_cast<char*>(&sum), sizeof sum);
    if (!stream_) throw InputError(path_.string() + ": the packed scene cannot be read to its end; copy it again");
    if (checksum(bytes) != sum) {
      throw InputError(path_.string() + ": the packed scene is damaged (a checksum does not match); copy it again");
    }
  }

  const fs::path& path_;
  std::ifstream stream_;
};

Json listing_to_json(const PackedListing& dataset) {
  Json photos = Json::array();
  for (const PackedPhoto& photo : dataset.photos) {
    const Camera& camera = photo.view.camera;
    const float* const matrix = glm::value_ptr(camera.camera_from_world);
    const std::vector<float> pose(matrix, matrix + 16);
    photos.push_back({{"name", photo.view.name},
                      {"width", camera.width},
                      {"height", camera.height},
                      {"photo_width", photo.photo_width},
                      {"photo_height", photo.photo_height},
                      {"fx", camera.fx},
                      {"fy", camera.fy},
                      {"cx", camera.cx},
                      {"cy", camera.cy},
                      {"camera_from_world", pose},
                      {"time", photo.view.time},
                      {"transparent", photo.transparent},
                      {"masked", photo.masked}});
  }
  Json few = Json::array();
  for (const auto& [views, cloud] : dataset.few_view_points)
    few.push_back({{"views", views}, {"points", cloud.size()}});
  Json listing{{"photos", photos},           {"own_test", dataset.own_test}, {"has_test_split", dataset.has_test_split},
               {"blender", dataset.blender}, {"images", dataset.images},     {"points", dataset.points.size()},
               {"few_view_points", few}};
  if (dataset.frames) listing["frames"] = *dataset.frames;
  return listing;
}

template <class T>
T take(const Json& object, const char* key) {
  T value{};
  if (!object.is_object() || !object.contains(key)) throw InputError(std::string("'") + key + "' is missing");
  read_value(object[key], std::string("'") + key + "'", value);
  return value;
}

int take_side(const Json& object, const char* key) {
  const int side = take<int>(object, key);
  require(side > 0 && side <= kLargestSide, std::string("'") + key + "' is out of range");
  return side;
}

PackedPhoto photo_from_json(const Json& json) {
  PackedPhoto photo;
  Camera& camera = photo.view.camera;
  photo.view.name = take<std::string>(json, "name");
  photo.view.time = take<float>(json, "time");
  photo.photo_width = take_side(json, "photo_width");
  photo.photo_height = take_side(json, "photo_height");
  photo.transparent = take<bool>(json, "transparent");
  photo.masked = take<bool>(json, "masked");
  camera.width = take_side(json, "width");
  camera.height = take_side(json, "height");
  camera.fx = take<float>(json, "fx");
  camera.fy = take<float>(json, "fy");
  camera.cx = take<float>(json, "cx");
  camera.cy = take<float>(json, "cy");
  const auto pose = take<std::vector<float>>(json, "camera_from_world");
  require(pose.size() == 16, "'camera_from_world' must hold 16 numbers");
  camera.camera_from_world = glm::make_mat4(pose.data());
  try {
    check_camera(camera);
  } catch (const ArgumentError& error) {
    throw InputError(photo.view.name + ": " + error.what());
  }
  return photo;
}

}  // namespace

void write_packed_scene(const fs::path& path, const PackedListing& dataset) {
  const std::string listing = listing_to_json(dataset).dump();
  write_file_atomically(path, [&](std::ostream& stream) {
    stream.write(kMagic.data(), static_cast<std::streamsize>(kMagic.size()));
    write_block(stream, bytes_of(std::vector<std::uint64_t>{listing.size()}));
    write_block(stream, std::as_bytes(std::span(listing)));
    const auto write_cloud = [&](const PointCloud& cloud) {
      write_block(stream, bytes_of(cloud.positions));
      write_block(stream, bytes_of(cloud.colors));
    };
    write_cloud(dataset.points);
    for (const auto& [views, cloud] : dataset.few_view_points) write_cloud(cloud);
    for (const PackedPhoto& photo : dataset.photos) {
      write_block(stream, bytes_of(photo.view.color));
      if (photo.transparent) write_block(stream, bytes_of(photo.color_over_white));
      if (photo.masked) write_block(stream, bytes_of(photo.view.valid));
    }
  });
}

bool is_packed_scene(const fs::path& path) {
  std::array<char, kMagic.size()> begin{};
  std::ifstream stream(path, std::ios::binary);
  stream.read(begin.data(), begin.size());
  const std::size_t fixed = kMagic.size() - kVersionDigits;
  return stream && std::string_view(begin.data(), fixed) == kMagic.substr(0, fixed);
}

PackedScene::PackedScene(fs::path path) : path_(std::move(path)) {
  const auto fail = [&](const std::string& what) { throw InputError(path_.string() + ": the packed scene " + what); };
  std::error_code error;
  const std::uint64_t size = fs::file_size(path_, error);
  if (error) fail("cannot be read: " + error.message());
  std::string magic(kMagic.size(), '\0');
  std::ifstream(path_, std::ios::binary).read(magic.data(), static_cast<std::streamsize>(magic.size()));
  if (magic != kMagic) {
    fail("has format version " + magic.substr(kMagic.size() - kVersionDigits) + ", this program reads " +
         std::string(kMagic.substr(kMagic.size() - kVersionDigits)) + "; pack the scene again, or update SplatBoost");
  }
  std::uint64_t at = kMagic.size() + block_bytes(sizeof(std::uint64_t));
  if (size < at) fail("is cut short; copy it again");
  BlockReader reader(path_, kMagic.size());
  const std::uint64_t listing_bytes = reader.block<std::uint64_t>(1)[0];
  if (listing_bytes > size - at) fail("is cut short; copy it again");
  const auto listing = reader.block<char>(listing_bytes);
  at += block_bytes(listing_bytes);

  std::uint64_t points = 0;
  std::vector<std::pair<int, std::uint64_t>> few;
  try {
    const Json json = parse_json({listing.data(), listing.size()}, "its JSON text");
    require(json.contains("photos") && json["photos"].is_array(), "'photos' must be a list");
    for (const Json& photo : json["photos"]) listing_.photos.push_back(photo_from_json(photo));
    listing_.own_test = take<std::size_t>(json, "own_test");
    require(listing_.own_test <= listing_.photos.size(), "'own_test' is out of range");
    listing_.has_test_split = take<bool>(json, "has_test_split");
    listing_.blender = take<bool>(json, "blender");
    listing_.images = take<std::string>(json, "images");
    if (json.contains("frames")) listing_.frames = take<int>(json, "frames");
    points = take<std::uint64_t>(json, "points");
    require(json.contains("few_view_points") && json["few_view_points"].is_array(), "'few_view_points' must be a list");
    for (const Json& cloud : json["few_view_points"]) {
      few.emplace_back(take<int>(cloud, "views"), take<std::uint64_t>(cloud, "points"));
    }
  } catch (const InputError& wrong) {
    fail(std::string("has an invalid listing: ") + wrong.what());
  }

  // Sizes are checked before anything is read or allocated according to the listing.
  std::uint64_t end = at;
  const auto add = [&](std::uint64_t bytes) {
    if (bytes > size - end) fail("is cut short: " + std::to_string(size) + " bytes; copy it again");
    end += bytes;
  };
  add(cloud_bytes(points <= size ? points : size));
  for (const auto& [views, count] : few) add(cloud_bytes(count <= size ? count : size));
  for (const PackedPhoto& photo : listing_.photos) {
    begins_.push_back(end);
    add(photo_bytes(photo));
  }
  if (end != size) fail("is damaged: bytes follow its end; copy it again");

  const auto read_cloud = [&](std::uint64_t count) {
    PointCloud cloud;
    cloud.positions = reader.block<float>(3 * count);
    cloud.colors = reader.block<std::uint8_t>(3 * count);
    return cloud;
  };
  listing_.points = read_cloud(points);
  for (const auto& [views, count] : few) listing_.few_view_points[views] = read_cloud(count);
}

View PackedScene::load(std::size_t index, bool white_background) const {
  const PackedPhoto& photo = listing_.photos.at(index);
  const auto pixels =
      static_cast<std::uint64_t>(photo.view.camera.width) * static_cast<std::uint64_t>(photo.view.camera.height);
  BlockReader reader(path_, begins_[index]);
  View view = photo.view;
  const bool over_white = photo.transparent && white_background;
  if (over_white) reader.skip(3 * pixels);
  view.color = reader.block<std::uint8_t>(3 * pixels);
  if (photo.transparent && !over_white) reader.skip(3 * pixels);
  if (photo.masked) view.valid = reader.block<std::uint8_t>(pixels);
  return view;
}

}  // namespace splatboost
