// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/packed_scene.h"

#include <gtest/gtest.h>

#include <functional>

#include <nlohmann/json.hpp>

#include "support/temporary_folder.h"
#include "trainer/dataset/view_image.h"
#include "trainer/formats/colmap.h"
#include "trainer/formats/read_scene.h"
#include "trainer/images/image_codec.h"

namespace splatboost::test {
namespace {

constexpr int kWidth = 34, kHeight = 26, kViews = 9;

/// A picture in which every pixel differs from its neighbours.
std::vector<std::uint8_t> texture(int channels, int seed) {
  std::vector<std::uint8_t> pixels(static_cast<std::size_t>(kWidth * kHeight * channels));
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    pixels[i] = static_cast<std::uint8_t>((i * 97 + i * i / 7 + static_cast<std::size_t>(seed) * 31) % 256);
  }
  return pixels;
}

/// A COLMAP scene with photos in two image folders, a point cloud for runs of 3 views, and optionally lens distortion.
void write_colmap_scene(const std::filesystem::path& folder, bool distorted) {
  ColmapModel model;
  model.cameras.push_back({1, distorted ? 2 : 0, kWidth, kHeight, {40, 17, 13}});
  if (distorted) model.cameras[0].params.push_back(0.35);
  for (int i = 0; i < kViews; ++i) {
    ColmapImage image;
    image.id = static_cast<std::uint32_t>(i + 1);
    image.camera_id = 1;
    image.name = "v" + std::to_string(i) + ".png";
    image.translation[0] = -0.37 * i;
    model.images.push_back(image);
    for (const char* images : {"images", "others"}) {
      std::filesystem::create_directories(folder / images);
      write_png(folder / images / image.name, kWidth, kHeight, 3,
                std::span<const std::uint8_t>(texture(3, i + (*images == 'o' ? 50 : 0))));
    }
  }
  model.points.positions = {1, 2, 3, 0.1f, -0.2f, 4};
  model.points.colors = {1, 2, 3, 4, 5, 6};
  std::filesystem::create_directories(folder / "sparse/0");
  write_colmap_model(folder / "sparse/0", model);
  write_file(folder / "3_views/dense/fused.ply",
             "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
             "end_header\n7 8 9\n");
}

/// Transparent photos with their own test split, and no points.
void write_blender_scene(const std::filesystem::path& folder) {
  for (const char* split : {"train", "test"}) {
    nlohmann::json frames = nlohmann::json::array();
    for (int i = 0; i < 4; ++i) {
      const std::string name = std::string(split) + "/r_" + std::to_string(i);
      std::filesystem::create_directories(folder / split);
      write_png(folder / (name + ".png"), kWidth, kHeight, 4,
                std::span<const std::uint8_t>(texture(4, i + (*split == 't' && split[1] == 'e' ? 20 : 0))));
      frames.push_back({{"file_path", "./" + name},
                        {"time", 0.3 * i},
                        {"transform_matrix", {{1, 0, 0, 0.1 * i}, {0, 1, 0, 0.7}, {0, 0, 1, 4}, {0, 0, 0, 1}}}});
    }
    write_file(folder / ("transforms_" + std::string(split) + ".json"),
               nlohmann::json({{"camera_angle_x", 0.7}, {"frames", frames}}).dump());
  }
}

bool same_camera(const Camera& a, const Camera& b) {
  return a.width == b.width && a.height == b.height && a.fx == b.fx && a.fy == b.fy && a.cx == b.cx && a.cy == b.cy &&
         a.camera_from_world == b.camera_from_world;
}

void expect_same_views(const std::vector<View>& a, const std::vector<View>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].name, b[i].name);
    EXPECT_EQ(a[i].color, b[i].color) << a[i].name;
    EXPECT_EQ(a[i].valid, b[i].valid) << a[i].name;
    EXPECT_EQ(a[i].time, b[i].time);
    EXPECT_TRUE(same_camera(a[i].camera, b[i].camera)) << a[i].name;
  }
}

void expect_same(const Scene& folder, const Scene& packed) {
  expect_same_views(folder.train, packed.train);
  expect_same_views(folder.test, packed.test);
  EXPECT_EQ(folder.points.positions, packed.points.positions);
  EXPECT_EQ(folder.points.colors, packed.points.colors);
  EXPECT_EQ(folder.extent, packed.extent);
  EXPECT_EQ(folder.white_background, packed.white_background);
}

/// A scene folder, and the packed file of it.
struct Pair {
  TemporaryFolder folder;
  SceneOptions options;
  std::filesystem::path file() const { return folder / "scene.sbscene"; }

  explicit Pair(const std::function<void(const std::filesystem::path&)>& write) {
    write(folder.path());
    options.source = folder.path();
  }
  void pack() const { pack_scene(options, file()); }
  void expect_equal(const SceneOptions& wanted) const {
    SceneOptions packed = wanted;
    packed.source = file();
    expect_same(read_scene(wanted), read_scene(packed));
  }
  std::string refused(const std::function<void(SceneOptions&)>& change = [](SceneOptions&) {}) const {
    SceneOptions packed = options;
    packed.source = file();
    change(packed);
    const std::string message = input_error_of([&] { read_scene(packed); });
    expect_contains(message, file().string());
    return message;
  }
};

TEST(PackedScene, GivesWhatTheFolderGives) {
  Pair pair([](const auto& folder) { write_colmap_scene(folder, false); });
  pair.pack();
  SceneOptions options = pair.options;
  pair.expect_equal(options);
  options.eval = true;
  pair.expect_equal(options);
  options.llffhold = 3;
  pair.expect_equal(options);
  for (const int views : {2, 3, 4, 100}) {  // the scene has a point cloud for 3
    options.n_views = views;
    pair.expect_equal(options);
  }
  options.n_views = 0;
  write_file(pair.folder / "list.txt", "v2\nv7.png\n");
  options.test_list = pair.folder / "list.txt";
  pair.expect_equal(options);
  options.white_background = true;
  pair.expect_equal(options);
  options.resolution = 1;  // the original size
  pair.expect_equal(options);
  options.images = "images";
  pair.expect_equal(options);
}

TEST(PackedScene, HoldsTransparentPhotosOverBothBackgrounds) {
  Pair pair(write_blender_scene);
  pair.options.random_points = 50;
  pair.pack();
  for (const bool white : {false, true}) {
    for (const bool eval : {false, true}) {
      SceneOptions options = pair.options;
      options.white_background = white;
      options.eval = eval;
      options.seed = 3;
      pair.expect_equal(options);
    }
  }
  SceneOptions white = pair.options;
  white.white_background = true;
  EXPECT_NE(read_scene(white).train[0].color, read_scene(pair.options).train[0].color);
}

TEST(PackedScene, HoldsWhatOtherSizesAndFoldersGive) {
  if (!have_opencv()) GTEST_SKIP() << "resizing needs OpenCV";
  Pair pair([](const auto& folder) { write_colmap_scene(folder, true); });
  pair.options.resolution = 2;
  pair.options.images = "others";
  pair.pack();
  pair.expect_equal(pair.options);
  SceneOptions as_packed;
  as_packed.source = pair.file();
  expect_same(read_scene(pair.options), read_scene(as_packed));
  EXPECT_FALSE(read_scene(as_packed).train[0].valid.empty());

  std::string message = pair.refused([](SceneOptions& o) { o.resolution = 1; });
  expect_contains(message, "packed at 17x13");
  expect_contains(message, "--resolution 1 requires 34x26");
  expect_contains(message, "pack the scene again");
  message = pair.refused([](SceneOptions& o) { o.images = "images"; });
  expect_contains(message, "'others', but --images is 'images'");
  message = pair.refused([](SceneOptions& o) { o.photo_scale = 0.5; });
  expect_contains(message, "at one size, but ncc_scale needs another");
}

TEST(PackedScene, RefusesFilesThatAreNotWhole) {
  Pair pair([](const auto& folder) { write_colmap_scene(folder, false); });
  pair.pack();
  const std::string whole = read_file(pair.file());
  const auto refused_as = [&](const std::string& content) {
    write_file(pair.file(), content);
    return pair.refused();
  };
  for (const std::size_t size :
       {std::size_t{8}, std::size_t{20}, std::size_t{100}, whole.size() / 2, whole.size() - 1}) {
    expect_contains(refused_as(whole.substr(0, size)), "cut short");
  }
  for (const std::size_t size : {std::size_t{0}, std::size_t{7}}) {
    expect_contains(refused_as(whole.substr(0, size)), "nor a packed scene");
  }
  expect_contains(refused_as(whole + "x"), "bytes follow its end");
  expect_contains(refused_as("PK\3\4" + whole), "nor a packed scene");
  expect_contains(refused_as(whole.substr(0, 6) + "02" + whole.substr(8)), "format version 02, this program reads 01");
  // One flipped bit anywhere after the magic.
  for (std::size_t at = 8; at < whole.size(); at += whole.size() / 61) {
    std::string damaged = whole;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x10);
    const std::string message = refused_as(damaged);
    EXPECT_TRUE(message.find("damaged") != std::string::npos || message.find("cut short") != std::string::npos)
        << at << ": " << message;
  }
  write_file(pair.file(), whole);
  pair.expect_equal(pair.options);
}

/// Files that pack_scene() does not write, because it refuses such datasets.
TEST(PackedScene, RefusesWhatDatasetsMayNotHold) {
  const TemporaryFolder folder;
  PackedPhoto photo;
  photo.view.name = "a.png";
  photo.view.camera.width = photo.view.camera.height = photo.photo_width = photo.photo_height = 2;
  photo.view.camera.fx = photo.view.camera.fy = 1;
  photo.view.color.assign(std::size_t{3} * 4, 9);
  PackedListing listing;
  listing.photos = {photo, photo};
  listing.points.positions = {0, 0, 3};
  listing.points.colors = {1, 2, 3};
  SceneOptions options;
  options.source = folder / "made.sbscene";
  write_packed_scene(options.source, listing);
  expect_contains(input_error_of([&] { read_scene(options); }), "made.sbscene: lists the image 'a.png' twice");
  listing.photos[1].view.time = 1;
  write_packed_scene(options.source, listing);
  EXPECT_EQ(read_scene(options).train.size(), 2u) << "two moments of one picture";
  listing.points.positions[2] = 4e13f;
  write_packed_scene(options.source, listing);
  expect_contains(input_error_of([&] { read_scene(options); }), "made.sbscene: point 0 is 4e+13 units away");
}

TEST(PackedScene, PacksOnlyFolders) {
  Pair pair([](const auto& folder) { write_colmap_scene(folder, false); });
  pair.pack();
  SceneOptions packed = pair.options;
  packed.source = pair.file();
  expect_contains(input_error_of([&] { pack_scene(packed, pair.folder / "again.sbscene"); }), "is packed already");
  EXPECT_FALSE(std::filesystem::exists(pair.folder / "again.sbscene"));
}

TEST(PackedScene, ABrokenPhotoLeavesNoFile) {
  Pair pair([](const auto& folder) { write_colmap_scene(folder, false); });
  write_file(pair.folder / "images/v4.png", "broken");
  expect_contains(input_error_of([&] { pair.pack(); }), "v4.png");
  EXPECT_FALSE(std::filesystem::exists(pair.file()));
}

}  // namespace
}  // namespace splatboost::test
