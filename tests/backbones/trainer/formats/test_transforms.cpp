// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/transforms.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include <glm/vec4.hpp>
#include <nlohmann/json.hpp>

#include "support/temporary_folder.h"
#include "trainer/formats/read_scene.h"
#include "trainer/images/image_codec.h"

namespace splatboost::test {
namespace {

using Json = nlohmann::json;

constexpr int kWidth = 40, kHeight = 24;

/// A camera at (0, 0, 4) that looks along -z at the origin, x right and y up, as in OpenGL.
Json pose(double x = 0, double y = 0, double z = 4) {
  return Json::parse("[[1,0,0," + std::to_string(x) + "],[0,1,0," + std::to_string(y) + "],[0,0,1," +
                     std::to_string(z) + "],[0,0,0,1]]");
}

Json frame(const std::string& file, double x = 0) { return {{"file_path", file}, {"transform_matrix", pose(x)}}; }

void write_rgba(const std::filesystem::path& path, std::uint8_t r, std::uint8_t g, std::uint8_t b, std::uint8_t a) {
  std::filesystem::create_directories(path.parent_path());
  std::vector<std::uint8_t> pixels;
  for (int i = 0; i < kWidth * kHeight; ++i) pixels.insert(pixels.end(), {r, g, b, a});
  write_png(path, kWidth, kHeight, 4, std::span<const std::uint8_t>(pixels));
}

struct BlenderScene {
  TemporaryFolder folder;
  BlenderScene() {
    Json train{{"camera_angle_x", 0.8}, {"frames", Json::array()}}, test = train;
    for (int i = 0; i < 5; ++i) {
      Json one = frame("./train/r_" + std::to_string(i), 0.1 * i);
      one["time"] = 0.25 * i;
      train["frames"].push_back(one);
      write_rgba(folder / ("train/r_" + std::to_string(i) + ".png"), 200, 100, 0, 128);
    }
    test["frames"].push_back(frame("./test/r_0"));
    test["frames"].back()["time"] = 0.5;
    write_rgba(folder / "test/r_0.png", 10, 20, 30, 255);
    write_file(folder / "transforms_train.json", train.dump());
    write_file(folder / "transforms_test.json", test.dump());
  }
  SceneOptions options() const {
    SceneOptions result;
    result.source = folder.path();
    return result;
  }
};

TEST(Transforms, BlenderSceneReadsAsWritten) {
  const BlenderScene disk;
  SceneOptions options = disk.options();
  options.eval = true;
  const Scene scene = read_scene(options);
  ASSERT_EQ(scene.train.size(), 5u);
  ASSERT_EQ(scene.test.size(), 1u);
  EXPECT_EQ(scene.train[3].name, "train/r_3.png");
  EXPECT_FLOAT_EQ(scene.train[3].time, 0.75f);
  const Camera& camera = scene.train[0].camera;
  const float focal = static_cast<float>(0.5 * kWidth / std::tan(0.4));
  EXPECT_FLOAT_EQ(camera.fx, focal);
  EXPECT_FLOAT_EQ(camera.fy, focal);
  EXPECT_FLOAT_EQ(camera.cx, 20);
  EXPECT_FLOAT_EQ(camera.cy, 12);

  // OpenGL has y up and z backward: the point is 4 in front of the camera, to the right of and above the image centre.
  const glm::vec4 p = camera.camera_from_world * glm::vec4(0.5, 0.25, 0, 1);
  EXPECT_NEAR(p.x, 0.5, 1e-6);
  EXPECT_NEAR(p.y, -0.25, 1e-6);
  EXPECT_NEAR(p.z, 4, 1e-6);
  EXPECT_NEAR(scene.train[2].camera.centre().x, 0.2, 1e-6);

  // Straight alpha over black.
  EXPECT_EQ(scene.train[0].color[0], 100);
  EXPECT_EQ(scene.train[0].color[kWidth * kHeight], 50);
  EXPECT_EQ(scene.train[0].color[2 * kWidth * kHeight], 0);
  // Without points: random points in a box, as in 3DGS.
  EXPECT_EQ(scene.points.size(), 100000u);
  float low = 9, high = -9;
  for (const float value : scene.points.positions) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  EXPECT_NEAR(low, -1.3f, 1e-3);
  EXPECT_NEAR(high, 1.3f, 1e-3);
}

TEST(Transforms, WhiteBackgroundIsUnderTransparentPixels) {
  const BlenderScene disk;
  SceneOptions options = disk.options();
  options.white_background = true;
  const Scene scene = read_scene(options);
  EXPECT_EQ(scene.train[0].color[0], 227);  // (200·128 + 255·127) / 255
  EXPECT_EQ(scene.train[0].color[kWidth * kHeight], 177);
  EXPECT_EQ(scene.train[0].color[2 * kWidth * kHeight], 127);
  EXPECT_TRUE(scene.white_background);
}

/// An uncompressed TIFF with 8-bit RGBA pixels whose colours are not multiplied by alpha.
std::string make_tiff(std::uint8_t r, std::uint8_t g, std::uint8_t b, std::uint8_t a) {
  std::string file("II*\0", 4);
  const auto put = [&](std::uint32_t value, int bytes) {
    for (int i = 0; i < bytes; ++i) file.push_back(static_cast<char>(value >> (8 * i)));
  };
  struct Tag {
    std::uint32_t number, type, count, value;
  };
  constexpr std::uint32_t kShort = 3, kLong = 4;
  constexpr std::uint32_t kTags = 11, kBits = 8 + 2 + 12 * kTags + 4, kPixels = kBits + 8;
  const Tag tags[kTags] = {{256, kShort, 1, kWidth}, {257, kShort, 1, kHeight}, {258, kShort, 4, kBits},
                           {259, kShort, 1, 1},      {262, kShort, 1, 2},       {273, kLong, 1, kPixels},
                           {277, kShort, 1, 4},      {278, kShort, 1, kHeight}, {279, kLong, 1, 4 * kWidth * kHeight},
                           {284, kShort, 1, 1},      {338, kShort, 1, 2}};
  put(8, 4);
  put(kTags, 2);
  for (const Tag& tag : tags) {
    put(tag.number, 2);
    put(tag.type, 2);
    put(tag.count, 4);
    put(tag.value, 4);
  }
  put(0, 4);
  for (int i = 0; i < 4; ++i) put(8, 2);
  for (int i = 0; i < kWidth * kHeight; ++i) {
    for (const std::uint8_t value : {r, g, b, a}) put(value, 1);
  }
  return file;
}

TEST(Transforms, TransparentTiffsAreRefusedOpaqueOnesAreNot) {
  if (!have_opencv()) GTEST_SKIP() << "TIFF needs OpenCV";
  const BlenderScene disk;
  write_file(disk.folder / "train/r_0.png", make_tiff(200, 100, 50, 255));  // the content decides, not the name
  const Scene scene = read_scene(disk.options());
  EXPECT_EQ(scene.train[0].color[0], 200);
  EXPECT_EQ(scene.train[0].color[2 * kWidth * kHeight], 50);
  write_file(disk.folder / "train/r_0.png", make_tiff(200, 100, 50, 128));
  const std::string message = input_error_of([&] { read_scene(disk.options()); });
  expect_contains(message, "r_0.png: transparent TIFF");
  expect_contains(message, "convert it to PNG");
}

TEST(Transforms, WithoutEvalTheTestViewsTrain) {
  const BlenderScene disk;
  const Scene scene = read_scene(disk.options());
  EXPECT_EQ(scene.train.size(), 6u);
  EXPECT_TRUE(scene.test.empty());
  EXPECT_EQ(scene.train.back().name, "test/r_0.png");
  EXPECT_EQ(scene.train.back().color[0], 10);
}

TEST(Transforms, SixteenBitAndGreyBecomeEightBitRgb) {
  const BlenderScene disk;
  std::vector<std::uint16_t> deep(kWidth * kHeight * 3, 257 * 77);
  write_png(disk.folder / "train/r_0.png", kWidth, kHeight, 3, std::span<const std::uint16_t>(deep));
  std::vector<std::uint8_t> grey(kWidth * kHeight, 33);
  write_png(disk.folder / "train/r_1.png", kWidth, kHeight, 1, std::span<const std::uint8_t>(grey));
  const Scene scene = read_scene(disk.options());
  for (const std::size_t channel : {0u, 1u, 2u}) {
    EXPECT_EQ(scene.train[0].color[channel * kWidth * kHeight + 5], 77);
    EXPECT_EQ(scene.train[1].color[channel * kWidth * kHeight + 5], 33);
  }
}

TEST(Transforms, NerfstudioIntrinsicsAreGlobalOrPerFrame) {
  const TemporaryFolder folder;
  Json json{{"w", 80},
            {"h", 48},
            {"fl_x", 60},
            {"fl_y", 62},
            {"cx", 41},
            {"cy", 23},
            {"camera_model", "OPENCV"},
            {"k1", 0.0},
            {"ply_file_path", "points.ply"},
            {"frames", {frame("images/b.png"), frame("images/a.png", 1)}}};
  json["frames"][0]["fl_x"] = 70;
  json["frames"][0]["cx"] = 40;
  write_file(folder / "transforms.json", json.dump());
  write_file(folder / "points.ply",
             "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float "
             "z\nend_header\n1 2 3\n4 5 6\n");
  write_rgba(folder / "images/a.png", 1, 2, 3, 255);  // half the size stated in the file
  write_rgba(folder / "images/b.png", 4, 5, 6, 255);
  SceneOptions options;
  options.source = folder.path();
  const Scene scene = read_scene(options);
  ASSERT_EQ(scene.train.size(), 2u);
  EXPECT_EQ(scene.train[0].name, "images/a.png");  // sorted by name
  EXPECT_FLOAT_EQ(scene.train[0].camera.fx, 30);
  EXPECT_FLOAT_EQ(scene.train[0].camera.fy, 31);
  EXPECT_FLOAT_EQ(scene.train[0].camera.cx, 20.5);
  EXPECT_FLOAT_EQ(scene.train[0].camera.cy, 11.5);
  EXPECT_FLOAT_EQ(scene.train[1].camera.fx, 35);
  EXPECT_FLOAT_EQ(scene.train[1].camera.cx, 20);
  EXPECT_EQ(scene.points.positions, (std::vector<float>{1, 2, 3, 4, 5, 6}));
}

TEST(Transforms, InstantNgpHasDistortionAndAnglesInsteadOfFocalLengths) {
  if (!have_opencv()) GTEST_SKIP() << "undistortion needs OpenCV";
  const TemporaryFolder folder;
  const Json json = {{"camera_angle_x", 1.0},
                     {"camera_angle_y", 0.7},
                     {"k1", 0.2},
                     {"p1", 0.001},
                     {"frames", {frame("images/a.png")}}};
  write_file(folder / "transforms.json", json.dump());
  write_rgba(folder / "images/a.png", 1, 2, 3, 255);
  SceneOptions options;
  options.source = folder.path();
  const Scene ngp = read_scene(options);
  EXPECT_FLOAT_EQ(ngp.train[0].camera.fx, static_cast<float>(20 / std::tan(0.5)));
  EXPECT_FLOAT_EQ(ngp.train[0].camera.fy, static_cast<float>(12 / std::tan(0.35)));
  ASSERT_FALSE(ngp.train[0].valid.empty());
  EXPECT_EQ(ngp.train[0].valid[0], 0);
}

/// A shared fl_y does not belong to a frame's own fl_x, nor a shared fl_x to a frame's own field of view.
TEST(Transforms, AFrameReplacesTheSharedFocalLengthsTogether) {
  const TemporaryFolder folder;
  write_rgba(folder / "a.png", 1, 2, 3, 255);
  const auto focal_lengths = [&](const Json& shared, const Json& own) {
    Json one = frame("a.png"), json = shared;
    one.update(own);
    json["frames"] = {one};
    write_file(folder / "transforms.json", json.dump());
    SceneOptions options;
    options.source = folder.path();
    options.random_points = 10;
    const Camera camera = read_scene(options).train.at(0).camera;
    return std::pair(camera.fx, camera.fy);
  };
  const Json shared{{"fl_x", 73.9}, {"fl_y", 70.1}};
  const auto wide = static_cast<float>(20 / std::tan(0.5)), high = static_cast<float>(12 / std::tan(0.35));
  EXPECT_EQ(focal_lengths(shared, {{"cx", 20}}), std::pair(73.9f, 70.1f));
  EXPECT_EQ(focal_lengths(shared, {{"fl_x", 200}}), std::pair(200.0f, 200.0f));
  EXPECT_EQ(focal_lengths(shared, {{"fl_y", 200}}), std::pair(200.0f, 200.0f));
  EXPECT_EQ(focal_lengths(shared, {{"fl_x", 200}, {"fl_y", 210}}), std::pair(200.0f, 210.0f));
  EXPECT_EQ(focal_lengths(shared, {{"camera_angle_x", 1.0}}), std::pair(wide, wide));
  EXPECT_EQ(focal_lengths({{"camera_angle_x", 0.9}}, {{"camera_angle_x", 1.0}, {"camera_angle_y", 0.7}}),
            std::pair(wide, high));
  EXPECT_EQ(focal_lengths({{"camera_angle_y", 0.7}}, Json::object()), std::pair(high, high));
}

/// Five frames, the left half of each with a black mask.
struct MaskedScene {
  TemporaryFolder folder;
  Json json{{"fl_x", 30}, {"frames", Json::array()}};
  MaskedScene() {
    std::vector<std::uint8_t> mask(kWidth * kHeight);
    for (std::size_t p = 0; p < mask.size(); ++p) mask[p] = p % kWidth < kWidth / 2 ? 0 : 255;
    for (int i = 0; i < 5; ++i) {
      const std::string name = std::to_string(i) + ".png";
      json["frames"].push_back(frame("images/" + name, 0.1 * i));
      json["frames"].back()["mask_path"] = "masks/" + name;
      write_rgba(folder / ("images/" + name), 200, 100, 0, 255);
      write_mask(name, mask);
    }
  }
  void write_mask(const std::string& name, const std::vector<std::uint8_t>& pixels) const {
    std::filesystem::create_directories(folder / "masks");
    write_png(folder / ("masks/" + name), kWidth, kHeight, 1, std::span<const std::uint8_t>(pixels));
  }
  SceneOptions options(int resolution = 1) const {
    write_file(folder / "transforms.json", json.dump());
    SceneOptions result;
    result.source = folder.path();
    result.resolution = resolution;
    result.random_points = 10;
    return result;
  }
  std::string error() const {
    return input_error_of([&] { read_scene(options()); });
  }
};

TEST(Transforms, BlackPixelsOfAMaskAreNotValid) {
  MaskedScene disk;
  disk.write_mask("3.png", std::vector<std::uint8_t>(kWidth * kHeight, 1));
  disk.json["frames"][4].erase("mask_path");
  const Scene scene = read_scene(disk.options());
  for (const std::size_t i : {0u, 1u, 2u}) {
    ASSERT_EQ(scene.train[i].valid.size(), static_cast<std::size_t>(kWidth * kHeight));
    for (std::size_t p = 0; p < scene.train[i].valid.size(); ++p) {
      ASSERT_EQ(scene.train[i].valid[p] != 0, p % kWidth >= kWidth / 2) << p;
    }
    EXPECT_EQ(scene.train[i].color[0], 200) << "pictures show what was there";
  }
  EXPECT_TRUE(scene.train[3].valid.empty());
  EXPECT_TRUE(scene.train[4].valid.empty());
  pack_scene(disk.options(), disk.folder / "packed.sbscene");
  SceneOptions packed = disk.options();
  packed.source = disk.folder / "packed.sbscene";
  EXPECT_EQ(read_scene(packed).train[1].valid, scene.train[1].valid);

  // Masks in colour or with 16 bits; their alpha does not count.
  write_rgba(disk.folder / "masks/3.png", 0, 0, 3, 0);
  const std::vector<std::uint16_t> deep(kWidth * kHeight, 1);
  write_png(disk.folder / "masks/2.png", kWidth, kHeight, 1, std::span<const std::uint16_t>(deep));
  EXPECT_TRUE(read_scene(disk.options()).train[2].valid.empty());
  EXPECT_TRUE(read_scene(disk.options()).train[3].valid.empty());

  if (!have_opencv()) GTEST_SKIP() << "no OpenCV";
  std::vector<std::uint8_t> dot(kWidth * kHeight, 255);
  dot[5 * kWidth + 7] = 0;
  disk.write_mask("2.png", dot);
  const View reduced = read_scene(disk.options(2)).train[2];
  ASSERT_EQ(reduced.valid.size(), static_cast<std::size_t>(kWidth * kHeight / 4));
  for (std::size_t p = 0; p < reduced.valid.size(); ++p) EXPECT_EQ(reduced.valid[p] == 0, p == 2 * kWidth / 2 + 3) << p;
}

TEST(Transforms, MasksAreUndistortedWithTheirPhotos) {
  if (!have_opencv()) GTEST_SKIP() << "undistortion needs OpenCV";
  MaskedScene disk;
  disk.json["k1"] = 0.3;
  disk.json["frames"][4].erase("mask_path");
  // A photo of the mask is undistorted like the mask; its values between black and white are at the mask's edge.
  std::filesystem::copy_file(disk.folder / "masks/0.png", disk.folder / "images/4.png",
                             std::filesystem::copy_options::overwrite_existing);
  const Scene scene = read_scene(disk.options());
  const View &masked = scene.train[0], &mask = scene.train[4];
  ASSERT_FALSE(masked.valid.empty());
  ASSERT_FALSE(mask.valid.empty()) << "the border";
  std::size_t black = 0;
  for (std::size_t p = 0; p < masked.valid.size(); ++p) {
    EXPECT_EQ(masked.valid[p] != 0, mask.valid[p] != 0 && mask.color[p] >= 128) << p;
    if (mask.valid[p] != 0 && masked.valid[p] == 0) ++black;
  }
  EXPECT_GT(black, static_cast<std::size_t>(kWidth * kHeight / 4));
}

TEST(Transforms, MasksThatCannotBeUsedAreNamed) {
  MaskedScene disk;
  disk.write_mask("1.png", std::vector<std::uint8_t>(kWidth * kHeight, 0));
  const std::string mask = (disk.folder / "masks/1.png").string(), listing = (disk.folder / "transforms.json").string();
  expect_contains(disk.error(), "images/1.png: its mask " + mask + " leaves no pixel of it; remove the image from");
  write_png(mask, 20, 12, 1, std::span<const std::uint8_t>(std::vector<std::uint8_t>(240, 255)));
  expect_contains(disk.error(), mask + ": is 20x12, but its photo " + (disk.folder / "images/1.png").string() +
                                    " is 40x24; a mask must have the size of its photo");
  std::filesystem::remove(mask);
  expect_contains(disk.error(), mask + ": the image does not exist; " + listing + " lists it");
  disk.json["frames"][1]["mask_path"] = 3;
  expect_contains(disk.error(), "frame 1: 'mask_path' is not a string");
}

TEST(Transforms, AnEmptyNameOfAMaskIsNoMask) {
  MaskedScene disk;
  disk.json["frames"][2]["mask_path"] = "";
  const Scene scene = read_scene(disk.options());
  EXPECT_TRUE(scene.train[2].valid.empty());
  EXPECT_FALSE(scene.train[1].valid.empty());
}

// Some tools write intrinsics in widths of the photo. Scenes were trained with them, to an image of nothing.
TEST(Transforms, IntrinsicsThatAreNotInPixelsAreRefused) {
  MaskedScene disk;
  const auto with = [&](const Json& intrinsics) {
    Json before = disk.json;
    disk.json.update(intrinsics);
    const std::string text = disk.error();
    disk.json = std::move(before);
    return text;
  };
  const std::string both = "; both must be in pixels of the photo",
                    listing = (disk.folder / "transforms.json").string();
  expect_contains(with({{"fl_x", 0.75}, {"fl_y", 1.25}, {"cx", 0.5}, {"cy", 0.5}}),
                  "images/0.png: its camera in " + listing +
                      " has a focal length of 0.75 and a principal point at 0.5 for 40 pixels" + both);
  expect_contains(with({{"cx", 200}}), "principal point at 200.0 for 40 pixels" + both);
  expect_contains(with({{"fl_y", 1}}), "focal length of 1.0 and a principal point at 12.0 for 24 pixels" + both);
  expect_contains(with({{"fl_x", 1e300}}), "needs finite focal lengths above zero");
  disk.json.update(Json{{"fl_x", 2.5}, {"cx", -30}});  // 166°, a crop
  EXPECT_EQ(read_scene(disk.options()).train.size(), 5u);
}

/// Frames 0 to 5 of nerfstudio, with lists of those to train on and to test.
struct NerfstudioScene {
  TemporaryFolder folder;
  Json json{{"fl_x", 30}, {"frames", Json::array()}};
  NerfstudioScene() {
    for (const int i : {5, 4, 3, 2, 1, 0}) {
      const std::string name = "images/" + std::to_string(i) + ".png";
      json["frames"].push_back(frame(name, 0.1 * i));
      write_rgba(folder / name, 200, 100, 0, 255);
    }
  }
  Scene read(bool eval = true) const {
    write_file(folder / "transforms.json", json.dump());
    SceneOptions options;
    options.source = folder.path();
    options.eval = eval;
    options.random_points = 10;
    return read_scene(options);
  }
};

std::string numbers_of(const std::vector<View>& views) {
  std::string numbers;
  for (const View& view : views) numbers += std::filesystem::path(view.name).stem().string();
  return numbers;
}

TEST(Transforms, NerfstudiosOwnSplitIsHeldOut) {
  NerfstudioScene disk;
  disk.json["val_filenames"] = {"images/4.png"};
  EXPECT_EQ(numbers_of(disk.read().test), "4") << "without test_filenames";
  disk.json["test_filenames"] = {"images/3.png", "./images/1.png"};
  Scene scene = disk.read();
  EXPECT_EQ(numbers_of(scene.train), "0245");
  EXPECT_EQ(numbers_of(scene.test), "13");
  EXPECT_EQ(scene.notes.size(), 1u) << "on points";
  EXPECT_EQ(disk.read(false).train.size(), 6u) << "as for Blender's scenes";

  disk.json["train_filenames"] = {"images/0.png", "images/5.png"};
  scene = disk.read();
  EXPECT_EQ(numbers_of(scene.train), "05");
  EXPECT_EQ(numbers_of(scene.test), "13");
  EXPECT_EQ(scene.notes.at(0), (disk.folder / "transforms.json").string() +
                                   ": 2 frames are left out: not in the lists of training and test frames");

  disk.json["test_filenames"] = disk.json["val_filenames"] = Json::array();  // as some tools write it
  scene = disk.read(false);
  EXPECT_EQ(numbers_of(scene.train), "05");
  expect_contains(scene.notes.at(0), "4 frames are left out: not in the list of training frames");
  disk.json.erase("train_filenames");
  EXPECT_EQ(numbers_of(disk.read().test), "0") << "every eighth";

  disk.json["train_filenames"] = disk.json["test_filenames"] = {"images/0.png", "images/1.png"};
  scene = disk.read();
  EXPECT_EQ(numbers_of(scene.train), "01");
  EXPECT_EQ(numbers_of(scene.test), "01");
  expect_contains(scene.notes.at(1), "2 images are both training and test views of the dataset");
}

TEST(Transforms, ListsOfASplitThatNameNoFrameAreRefused) {
  NerfstudioScene disk;
  disk.json["test_filenames"] = {"images/1.png", "1.png"};
  expect_contains(input_error_of([&] { disk.read(); }),
                  "transforms.json: 'test_filenames' lists '1.png', which is the file_path of no frame");
  disk.json["test_filenames"] = "images/1.png";
  expect_contains(input_error_of([&] { disk.read(); }), "'test_filenames' is not a list of strings");
  disk.json["test_filenames"] = {1};
  expect_contains(input_error_of([&] { disk.read(); }), "'test_filenames' is not a list of strings");
}

/// The rest of the dataset's own test split used to be trained on.
TEST(Transforms, TestViewsThatAListLeavesOutAreNotTrainedOn) {
  const BlenderScene disk;
  Json test = Json::parse(read_file(disk.folder / "transforms_test.json"));
  test["frames"].push_back(test["frames"][0]);
  test["frames"].back()["file_path"] = "./test/r_8";
  write_file(disk.folder / "transforms_test.json", test.dump());
  write_rgba(disk.folder / "test/r_8.png", 10, 20, 30, 255);
  SceneOptions options = disk.options();
  options.test_list = disk.folder / "list.txt";
  for (const bool eval : {true, false}) {
    options.eval = eval;
    write_file(options.test_list, "r_8\n");
    Scene scene = read_scene(options);
    EXPECT_EQ(numbers_of(scene.train), "r_0r_1r_2r_3r_4");
    EXPECT_EQ(numbers_of(scene.test), "r_8");
    EXPECT_EQ(scene.notes.at(0), "1 image of the dataset's own test split is not in " + options.test_list.string() +
                                     ": neither trained on nor tested");
    write_file(options.test_list, "train/r_1\n");
    scene = read_scene(options);
    EXPECT_EQ(numbers_of(scene.train), "r_0r_2r_3r_4");
    EXPECT_EQ(scene.test.at(0).name, "train/r_1.png");
    expect_contains(scene.notes.at(0), "2 images of the dataset's own test split are not in");
    write_file(options.test_list, "r_8\nr_0\n");
    scene = read_scene(options);
    EXPECT_EQ(numbers_of(scene.train), "r_1r_2r_3r_4");
    EXPECT_EQ(numbers_of(scene.test), "r_0r_0r_8") << "of train/ and test/";
    EXPECT_EQ(scene.notes.at(0), options.test_list.string() +
                                     ": 'r_0' matches 2 images, which are all held out; name " +
                                     "an image with its folder to hold out that one alone");
  }
}

TEST(Transforms, AScaleInTheRotationIsTakenOut) {
  const TemporaryFolder folder;
  Json one = frame("a");
  one["transform_matrix"] = Json::parse("[[0,-2,0,1],[2,0,0,2],[0,0,2,3],[0,0,0,1]]");
  write_file(folder / "transforms.json", Json{{"camera_angle_x", 1.0}, {"frames", {one}}}.dump());
  const Photo photo = read_transforms(folder / "transforms.json").photos.at(0);
  // Camera-to-world rotates x to y: one unit along world y is one unit to the right in the camera.
  const glm::dvec4 p = photo.camera_from_world * glm::dvec4(1, 3, 3 - 5, 1);
  EXPECT_NEAR(p.x, 1, 1e-12);
  EXPECT_NEAR(p.y, 0, 1e-12);
  EXPECT_NEAR(p.z, 5, 1e-12);
}

TEST(Transforms, TheLastRowOfAPoseMayBeLeftOut) {
  const TemporaryFolder folder;
  Json one = frame("a");
  one["transform_matrix"].erase(3);
  write_file(folder / "transforms.json", Json{{"camera_angle_x", 1.0}, {"frames", {one}}}.dump());
  EXPECT_EQ(read_transforms(folder / "transforms.json").photos.size(), 1u);
}

TEST(Transforms, BrokenInputIsNamed) {
  const TemporaryFolder folder;
  const auto message = [&](const std::string& content) {
    write_file(folder / "transforms.json", content);
    const std::string text = input_error_of([&] { read_transforms(folder / "transforms.json"); });
    expect_contains(text, "transforms.json: ");
    return text;
  };
  const Json good{{"camera_angle_x", 1.0}, {"frames", {frame("a"), frame("b")}}};
  const auto broken = [&](auto&& change) {
    Json json = good;
    change(json);
    return message(json.dump());
  };
  EXPECT_EQ(
      (write_file(folder / "transforms.json", good.dump()), read_transforms(folder / "transforms.json").photos.size()),
      2u);
  expect_contains(message("{\n \"frames\": [,]\n}"), "not JSON: parse error at line 2");
  expect_contains(message(good.dump().substr(0, 60)), "not JSON");
  expect_contains(message("[1, 2]"), "must hold a JSON object");
  expect_contains(message("{}"), "no list 'frames'");
  expect_contains(broken([](Json& j) { j["frames"] = Json::array(); }), "lists no frames");
  expect_contains(broken([](Json& j) { j.erase("camera_angle_x"); }), "frame 0: neither a focal length");
  expect_contains(broken([](Json& j) { j["fl_x"] = 0; }), "'fl_x'");
  expect_contains(broken([](Json& j) { j["fl_x"] = "wide"; }), "'fl_x' is not a number");
  expect_contains(broken([](Json& j) { j["camera_angle_x"] = -1; }), "field of view");
  expect_contains(broken([](Json& j) { j["cx"] = nullptr; }), "'cx' is not a number");  // NaN is written as null
  expect_contains(broken([](Json& j) { j["camera_model"] = "OPENCV_FISHEYE"; }), "OPENCV_FISHEYE is not supported");
  expect_contains(broken([](Json& j) { j["is_fisheye"] = true; }), "fisheye cameras are not supported");
  expect_contains(broken([](Json& j) { j["is_fisheye"] = "true"; }), "is_fisheye must be true or false");
  expect_contains(broken([](Json& j) { j["w"] = 0; }), "'w'");
  expect_contains(broken([](Json& j) { j["frames"][1].erase("file_path"); }), "frame 1: has no 'file_path'");
  expect_contains(broken([](Json& j) { j["frames"][1].erase("transform_matrix"); }),
                  "frame 1: has no 'transform_matrix'");
  expect_contains(broken([](Json& j) { j["frames"][1]["transform_matrix"][0][0] = nullptr; }), "4x4");
  expect_contains(broken([](Json& j) { j["frames"][1]["transform_matrix"][1].erase(3); }), "4x4");
  expect_contains(broken([](Json& j) { j["frames"][1]["transform_matrix"][0][0] = -1; }), "determinant");
  expect_contains(broken([](Json& j) { j["frames"][1]["transform_matrix"][0][1] = 0.5; }), "orthogonal");
  const auto with_pose = [&](const char* rows) {
    return broken([&](Json& j) { j["frames"][1]["transform_matrix"] = Json::parse(rows); });
  };
  expect_contains(with_pose("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,4,1]]"),
                  "frame 1: 'transform_matrix' does not end with the row 0 0 0 1; it must be camera to world, row by "
                  "row (is it transposed?)");
  expect_contains(with_pose("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,2]]"), "does not end with the row 0 0 0 1");
  expect_contains(with_pose("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,1]]"), "4x4");
  expect_contains(broken([](Json& j) { j["frames"][1]["time"] = 3; }), "'time'");
  expect_contains(broken([](Json& j) { j["frames"][1]["time"] = 0.5; }), "frame 0 has no 'time', but frame 1 has one");
  expect_contains(broken([](Json& j) { j["frames"][0]["time"] = 0; }), "frame 1 has no 'time', but frame 0 has one");
}

TEST(Transforms, AFrameListedTwiceIsRefused) {
  const BlenderScene disk;
  const std::string whole = read_file(disk.folder / "transforms_train.json");
  Json train = Json::parse(whole);
  train["frames"].push_back(train["frames"][1]);
  train["frames"].back()["file_path"] = "train/../train/r_1.png";
  write_file(disk.folder / "transforms_train.json", train.dump());
  expect_contains(input_error_of([&] { read_scene(disk.options()); }),
                  "transforms_train.json: lists the image 'train/r_1.png' twice; remove one");
  train["frames"].back()["time"] = 0.9;  // another moment of a picture that does not change
  write_file(disk.folder / "transforms_train.json", train.dump());
  EXPECT_EQ(read_scene(disk.options()).train.size(), 7u);

  write_file(disk.folder / "transforms_train.json", whole);
  write_file(disk.folder / "transforms_test.json", whole);
  const std::vector<std::string> notes = read_scene(disk.options()).notes;  // a copy, because 3DGS wants both files
  EXPECT_EQ(std::ranges::count_if(notes, [](const auto& n) { return n.starts_with("5 images are both training"); }), 1);

  std::filesystem::remove(disk.folder / "transforms_test.json");
  std::filesystem::remove(disk.folder / "transforms_train.json");
  train["frames"].push_back(train["frames"][3]);
  write_file(disk.folder / "transforms.json", train.dump());
  expect_contains(input_error_of([&] { read_scene(disk.options()); }),
                  "transforms.json: lists the image 'train/r_3.png' twice; remove one");
}

TEST(Transforms, WithoutATestFileViewsAreHeldOutAndNamed) {
  const BlenderScene disk;
  std::filesystem::remove(disk.folder / "transforms_test.json");
  SceneOptions options = disk.options();
  options.eval = true;
  options.llffhold = 4;
  const Scene scene = read_scene(options);
  EXPECT_EQ(scene.test.size(), 2u);
  ASSERT_FALSE(scene.notes.empty());
  expect_contains(scene.notes.front(), "transforms_test.json: missing, so every 4th training view is a test view");
}

TEST(Transforms, PointsFarAwayAreNamedWithTheirFile) {
  const BlenderScene disk;
  const auto error = [&] { return input_error_of([&] { read_scene(disk.options()); }); };
  const std::string cloud =
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
      "end_header\n0 0 4e13\n";
  write_file(disk.folder / "points3d.ply", cloud);
  expect_contains(error(), (disk.folder / "points3d.ply").string() + ": point 0 is 4e+13 units away");
  write_file(disk.folder / "cloud.ply", cloud);
  Json train = Json::parse(read_file(disk.folder / "transforms_train.json"));
  train["ply_file_path"] = "cloud.ply";
  write_file(disk.folder / "transforms_train.json", train.dump());
  expect_contains(error(), (disk.folder / "cloud.ply").string() + ": point 0 is 4e+13 units away");
  std::filesystem::rename(disk.folder / "transforms_train.json", disk.folder / "transforms.json");
  expect_contains(error(), (disk.folder / "cloud.ply").string() + ": point 0 is 4e+13 units away");
}

TEST(Transforms, OptionsWithoutEffectAreNamed) {
  const BlenderScene disk;
  SceneOptions options = disk.options();
  options.random_points = 10;
  EXPECT_EQ(read_scene(options).notes.size(), 1u) << "on points";
  options.images = "images_4";
  options.frames = 0;
  options.frame_times = true;
  const auto expect_notes = [&](const std::string& listing) {
    const std::vector<std::string> notes = read_scene(options).notes;
    ASSERT_EQ(notes.size(), 4u);
    const std::string place = " has no effect on " + (disk.folder / listing).string() + ": it is for ";
    EXPECT_EQ(notes[0], "--images" + place + "COLMAP scenes and captures of Nerfies");
    EXPECT_EQ(notes[1], "--frames" + place + "rigs of videos");
    EXPECT_EQ(notes[2], "--frame-times" + place + "COLMAP scenes");
  };
  expect_notes("transforms_train.json");
  options.images = "images";  // the name in the file, whatever was given
  pack_scene(options, disk.folder / "packed.sbscene");
  options.source = disk.folder / "packed.sbscene";
  expect_notes("packed.sbscene");
  options.source = disk.folder.path();
  std::filesystem::rename(disk.folder / "transforms_train.json", disk.folder / "transforms.json");
  expect_notes("transforms.json");
}

TEST(Transforms, MissingImagesAreNamedWithTheirExtension) {
  const BlenderScene disk;
  std::filesystem::remove(disk.folder / "train/r_2.png");
  const std::string message = input_error_of([&] { read_scene(disk.options()); });
  expect_contains(message, "train/r_2.png: the image does not exist");
  expect_contains(message, "transforms_train.json");
}

}  // namespace
}  // namespace splatboost::test
