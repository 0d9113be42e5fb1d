// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/read_scene.h"

#include <gtest/gtest.h>

#include <algorithm>

#include <cmath>
#include <cstdio>

#include <glm/geometric.hpp>
#include <glm/vec4.hpp>

#include "support/temporary_folder.h"
#include "trainer/dataset/view_image.h"
#include "trainer/formats/colmap.h"
#include "trainer/images/image_codec.h"

namespace splatboost::test {
namespace {

constexpr int kWidth = 64, kHeight = 48, kViews = 10;

/// Ten cameras in a row along x that look along z; photo i has the grey value 10 i.
struct Row {
  TemporaryFolder folder;

  explicit Row(const std::vector<float>& points = {1, 2, 3, 2, 2, 3}) {
    ColmapModel model;
    model.cameras.push_back({1, 0, kWidth, kHeight, {50, 32, 24}});
    for (int i = kViews - 1; i >= 0; --i) {  // not in the order of their names
      ColmapImage image;
      image.id = static_cast<std::uint32_t>(i + 1);
      image.camera_id = 1;
      image.name = "v0.png";
      image.name[1] = static_cast<char>('0' + i);
      image.translation[0] = -i;
      model.images.push_back(image);
      std::vector<std::uint8_t> pixels(kWidth * kHeight, static_cast<std::uint8_t>(10 * i));
      write(image.name, pixels);
    }
    model.points.positions = points;
    for (std::size_t i = 0; i < points.size(); ++i) model.points.colors.push_back(static_cast<std::uint8_t>(i + 1));
    std::filesystem::create_directories(folder / "sparse/0");
    write_colmap_model(folder / "sparse/0", model);
  }

  void write(const std::string& name, const std::vector<std::uint8_t>& pixels) const {
    std::filesystem::create_directories(folder / "images");
    write_png(folder.path() / "images" / name, kWidth, kHeight, 1, std::span<const std::uint8_t>(pixels));
  }

  SceneOptions options() const {
    SceneOptions result;
    result.source = folder.path();
    return result;
  }
};

std::string names(const std::vector<View>& views) {
  std::string text;
  for (const View& view : views) text += view.name.substr(0, view.name.find('.')) + " ";
  return text;
}

TEST(ReadScene, KeepsOrderWhateverThreadReads) {
  const Row row;
  const Scene scene = read_scene(row.options());
  EXPECT_EQ(names(scene.train), "v0 v1 v2 v3 v4 v5 v6 v7 v8 v9 ");
  for (int i = 0; i < kViews; ++i) {
    EXPECT_EQ(scene.train[static_cast<std::size_t>(i)].color[0], 10 * i);
    EXPECT_FLOAT_EQ(scene.train[static_cast<std::size_t>(i)].camera.centre().x, static_cast<float>(i));
  }
  EXPECT_FLOAT_EQ(scene.extent, 1.1f * 4.5f);
}

// One wrong point of many made the scene of one camera a thousand times as large.
TEST(ReadScene, AWrongPointDoesNotSetTheExtent) {
  std::vector<float> points;
  for (int i = 0; i < 300; ++i) points.insert(points.end(), {0.01f * static_cast<float>(i), 0, 4});
  points.insert(points.end(), {3000, 2000, 1000});
  const Row row(points);
  SceneOptions options = row.options();
  options.n_views = 1;
  EXPECT_NEAR(read_scene(options).extent, std::hypot(4.0, 2.97), 0.02);
}

TEST(ReadScene, WhatIsBeforeTheNearPlaneIsTold) {
  const Row near({1, 0, 0.1f, 1, 0.01f, 0.19f, 1, 0, 3}), far({1, 0, 1, 1, 0, 3});
  const std::vector<std::string> notes = read_scene(near.options()).notes;
  ASSERT_EQ(notes.size(), 1u);
  // Cameras at x = 0 to 2 see the far point, the one at 1 the others.
  EXPECT_EQ(notes[0],
            "40 % of the points in the views are nearer than 0.2 units, where nothing is drawn (near plane); scale "
            "poses and points up");
  EXPECT_TRUE(read_scene(far.options()).notes.empty());
}

TEST(ReadScene, SplitsAsAsked) {
  const Row row;
  SceneOptions options = row.options();
  options.eval = true;
  Scene scene = read_scene(options);
  EXPECT_EQ(names(scene.test), "v0 v8 ");
  EXPECT_EQ(names(scene.train), "v1 v2 v3 v4 v5 v6 v7 v9 ");
  EXPECT_FLOAT_EQ(scene.extent, 1.1f * (9 - 37.0f / 8));

  options.llffhold = 3;
  scene = read_scene(options);
  EXPECT_EQ(names(scene.test), "v0 v3 v6 v9 ");

  options.n_views = 3;
  scene = read_scene(options);
  EXPECT_EQ(names(scene.train), "v1 v4 v8 ") << "of v1 v2 v4 v5 v7 v8: 2.5 rounds to the even 2";
  EXPECT_EQ(names(scene.test), "v0 v3 v6 v9 ");

  options.n_views = 1;
  EXPECT_EQ(names(read_scene(options).train), "v1 ");
  EXPECT_FLOAT_EQ(read_scene(options).extent, std::sqrt(14.0f)) << "of the farther of two points";
  options.n_views = 50;
  EXPECT_EQ(read_scene(options).train.size(), 6u);

  options.llffhold = 1;
  std::string message = input_error_of([&] { read_scene(options); });
  expect_contains(message, "all 10 images are held out");
  expect_contains(message, "raise --llffhold");
  options.test_list = row.folder / "all.txt";
  write_file(options.test_list, "v0\nv1\nv2\nv3\nv4\nv5\nv6\nv7\nv8\nv9\n");
  message = input_error_of([&] { read_scene(options); });
  expect_contains(message, "all 10 images are held out");
  expect_contains(message, "shorten the list");
  options.test_list.clear();
  options.llffhold = 0;
  expect_contains(input_error_of([&] { read_scene(options); }), "llffhold 0");
}

TEST(ReadScene, ALargerPartOfTheReconstructionIsNoted) {
  const Row row;
  ColmapModel model = read_colmap_model(row.folder / "sparse/0");
  const auto noted = [&] {
    const std::vector<std::string> notes = read_scene(row.options()).notes;
    return std::ranges::count_if(notes, [](const std::string& note) { return note.find("sparse/1: ") != note.npos; });
  };
  std::filesystem::create_directories(row.folder / "sparse/1");
  write_colmap_model(row.folder / "sparse/1", model);
  EXPECT_EQ(noted(), 0) << "as many images";
  model.images.push_back(model.images.back());
  model.images.back().id = 1000;
  model.images.back().name = "v1000.png";
  write_colmap_model(row.folder / "sparse/1", model);
  EXPECT_EQ(noted(), 1);
  write_file(row.folder / "sparse/1/images.bin", "cut short");
  EXPECT_EQ(noted(), 0) << "a damaged model that is not used";
}

TEST(ReadScene, AnImageListedTwiceIsRefused) {
  const Row row;
  for (const char* again : {"v8.png", "./v8.png"}) {  // the same file under both names
    ColmapModel model = read_colmap_model(row.folder / "sparse/0");
    model.images.push_back(model.images.front());
    model.images.back().name = again;
    const Row damaged;
    write_colmap_model(damaged.folder / "sparse/0", model);
    const std::string message = input_error_of([&] { read_scene(damaged.options()); });
    expect_contains(message, "sparse/0/images.bin: lists the image 'v8.png' twice");
    EXPECT_EQ(input_error_of([&] { pack_scene(damaged.options(), damaged.folder / "x.sbscene"); }), message);
  }
}

TEST(ReadScene, TheOnlyPhotoCannotBeHeldOut) {
  const Row row;
  ColmapModel model = read_colmap_model(row.folder / "sparse/0");
  model.images.resize(1);
  write_colmap_model(row.folder / "sparse/0", model);
  SceneOptions options = row.options();
  EXPECT_EQ(read_scene(options).train.size(), 1u);
  options.eval = true;
  std::string message = input_error_of([&] { read_scene(options); });
  expect_contains(message, "images.bin: its only image is held out");
  expect_contains(message, "leave out --eval");
  EXPECT_EQ(message.find("llffhold"), std::string::npos) << message;
  options.eval = false;
  options.test_list = row.folder / "test.txt";
  write_file(options.test_list, model.images[0].name);
  expect_contains(input_error_of([&] { read_scene(options); }), "leave out --test-list");
}

TEST(ReadScene, OptionsWithoutEffectAreNamed) {
  const Row row;
  SceneOptions options = row.options();
  options.images = "images";
  options.resolution = kWidth;
  EXPECT_EQ(read_scene(options).notes, std::vector<std::string>{});
  options.frames = 3;
  options.resolution = 300;
  const std::vector<std::string> notes = read_scene(options).notes;
  ASSERT_EQ(notes.size(), 2u);
  EXPECT_EQ(notes[0], "--frames has no effect on " + (row.folder / "sparse/0/images.bin").string() +
                          ": it is for rigs of videos");
  EXPECT_EQ(notes[1], "--resolution 300 has no effect: the photos are at most 64 px wide, and photos are not enlarged");
  EXPECT_EQ(pack_scene(options, row.folder / "row.sbscene"), notes);
  options.source = row.folder / "row.sbscene";
  const std::vector<std::string> packed = read_scene(options).notes;
  ASSERT_EQ(packed.size(), 2u);
  expect_contains(packed[0], "--frames has no effect on " + options.source.string());
  EXPECT_EQ(packed[1], notes[1]);
}

TEST(ReadScene, FewViewsStartFromPointsOfTheirOwn) {
  const Row row;
  SceneOptions options = row.options();
  options.n_views = 3;
  EXPECT_EQ(read_scene(options).points.positions, (std::vector<float>{1, 2, 3, 2, 2, 3}));
  write_file(row.folder / "3_views/dense/fused.ply",
             "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
             "end_header\n4 5 6\n7 8 9\n");
  const Scene scene = read_scene(options);
  EXPECT_EQ(scene.points.positions, (std::vector<float>{4, 5, 6, 7, 8, 9}));
  ASSERT_EQ(scene.notes.size(), 1u);
  expect_contains(scene.notes[0], "3_views/dense/fused.ply");
  options.n_views = 4;
  EXPECT_EQ(read_scene(options).points.size(), 2u) << "other views have other points";
}

TEST(ReadScene, ATestListGoesBeforeTheRule) {
  const Row row;
  SceneOptions options = row.options();
  options.eval = true;
  options.test_list = row.folder / "test.txt";
  write_file(options.test_list, "# held out\nv7.png\r\n\n  v2\n");
  Scene scene = read_scene(options);
  EXPECT_EQ(names(scene.test), "v2 v7 ");
  EXPECT_EQ(scene.train.size(), 8u);
  EXPECT_TRUE(scene.notes.empty());
  options.llffhold = 3;
  scene = read_scene(options);
  EXPECT_EQ(names(scene.test), "v2 v7 ");
  ASSERT_EQ(scene.notes.size(), 1u);
  expect_contains(scene.notes[0], "--llffhold has no effect");
  write_file(options.test_list, "\xef\xbb\xbfv7.png\nv2\n");
  EXPECT_EQ(names(read_scene(options).test), "v2 v7 ");
  write_file(options.test_list, "v7.png\nv77.png\n");
  std::string message = input_error_of([&] { read_scene(options); });
  expect_contains(message, "test.txt");
  expect_contains(message, "'v77.png' matches no image");
  write_file(options.test_list, "\n# nothing\n");
  expect_contains(input_error_of([&] { read_scene(options); }), "empty");
  options.test_list = row.folder / "none.txt";
  expect_contains(input_error_of([&] { read_scene(options); }), "none.txt");
}

TEST(ReadScene, ResolutionAveragesAreasAndScalesTheCamera) {
  if (!have_opencv()) GTEST_SKIP() << "resizing needs OpenCV";
  const Row row;
  std::vector<std::uint8_t> pixels(kWidth * kHeight);
  for (std::size_t i = 0; i < pixels.size(); ++i) pixels[i] = i % 2 == 0 ? 40 : 80;
  row.write("v0.png", pixels);
  SceneOptions options = row.options();
  options.resolution = 2;
  Scene scene = read_scene(options);
  EXPECT_EQ(scene.train[0].camera.width, 32);
  EXPECT_EQ(scene.train[0].camera.height, 24);
  EXPECT_FLOAT_EQ(scene.train[0].camera.fx, 25);
  EXPECT_FLOAT_EQ(scene.train[0].camera.cx, 16);
  EXPECT_FLOAT_EQ(scene.train[0].camera.cy, 12);
  for (const std::uint8_t value : scene.train[0].color) ASSERT_EQ(value, 60);
  options.resolution = 16;
  scene = read_scene(options);
  EXPECT_EQ(scene.train[0].camera.width, 16);
  EXPECT_EQ(scene.train[0].camera.height, 12);
  EXPECT_FLOAT_EQ(scene.train[0].camera.fy, 12.5);
  options.resolution = 5000;
  EXPECT_EQ(read_scene(options).train[0].camera.width, kWidth);
  for (const int wrong : {0, 3, -2, 9}) {
    options.resolution = wrong;
    expect_contains(input_error_of([&] { read_scene(options); }), "resolution " + std::to_string(wrong));
  }
}

TEST(ReadScene, PhotosOfAnotherScaleHaveTheirOwnCameras) {
  if (!have_opencv()) GTEST_SKIP() << "resizing needs OpenCV";
  const Row row;
  SceneOptions options = row.options();
  options.resolution = 4;  // 16x12
  options.photo_scale = 0.5;
  Camera camera = read_scene(options).train[0].camera;
  EXPECT_EQ(camera.width, 32);
  EXPECT_EQ(camera.height, 24);
  EXPECT_FLOAT_EQ(camera.fx, 25);
  options.photo_scale = 1.5;
  camera = read_scene(options).train[0].camera;
  EXPECT_EQ(camera.width, 10) << "rounded down";
  EXPECT_EQ(camera.height, 8);
  options.photo_scale = 0.2;
  const std::string message = input_error_of([&] { read_scene(options); });
  expect_contains(message, "v0.png: has 64x48 pixels, but ncc_scale needs 80x60");

  const Row odd;
  write_png(odd.folder / "images/v0.png", 63, 47, 1,
            std::span<const std::uint8_t>(std::vector<std::uint8_t>(std::size_t{63} * 47, 9)));
  options = odd.options();
  options.resolution = 2;  // 31.5 and 23.5 are rounded to even
  options.photo_scale = 0.5;
  EXPECT_EQ(read_scene(options).train[0].camera.width, 63) << "not 64";
}

TEST(ReadScene, DivisorsRoundHalvesToEvenAsIn3dgs) {
  EXPECT_EQ(target_size(530, 946, 4), (ImageSize{132, 236}));     // 132.5, 236.5
  EXPECT_EQ(target_size(4946, 3286, 4), (ImageSize{1236, 822}));  // 1236.5, 821.5
  EXPECT_EQ(target_size(799, 719, 2), (ImageSize{400, 360}));     // 399.5, 359.5
  EXPECT_EQ(target_size(530, 946, 8), (ImageSize{66, 118}));      // 66.25, 118.25
  EXPECT_EQ(target_size(1, 3, 8), (ImageSize{1, 1}));
}

TEST(ReadScene, WidePhotosAreLimitedWithANote) {
  if (!have_opencv()) GTEST_SKIP() << "resizing needs OpenCV";
  const TemporaryFolder folder;
  ColmapModel model;
  model.cameras.push_back({1, 1, 3200, 40, {1000, 1000, 1500, 20}});
  ColmapImage image;
  image.camera_id = 1;
  image.name = "wide.png";
  model.images.push_back(image);
  model.points.positions = {0, 0, 3, 0, 1, 3};
  model.points.colors = {1, 2, 3, 1, 2, 3};
  std::filesystem::create_directories(folder / "sparse/0");
  std::filesystem::create_directories(folder / "images");
  write_colmap_model(folder / "sparse/0", model);
  const std::vector<std::uint8_t> pixels(3200 * 40, 9);
  write_png(folder / "images/wide.png", 3200, 40, 1, std::span<const std::uint8_t>(pixels));
  SceneOptions options;
  options.source = folder.path();
  Scene scene = read_scene(options);
  EXPECT_EQ(scene.train[0].camera.width, 1600);
  EXPECT_EQ(scene.train[0].camera.height, 20);
  EXPECT_FLOAT_EQ(scene.train[0].camera.cx, 750);
  ASSERT_FALSE(scene.notes.empty());
  expect_contains(scene.notes[0], "1600");
  options.resolution = 1;
  EXPECT_EQ(read_scene(options).train[0].camera.width, 3200);
}

TEST(ReadScene, RandomPointsLieWhereTheCamerasLook) {
  const Row row(std::vector<float>{});
  SceneOptions options = row.options();
  options.random_points = 2000;
  const Scene scene = read_scene(options);
  ASSERT_EQ(scene.points.size(), 2000u);
  std::size_t in_front = 0;
  for (std::size_t i = 0; i < 2000; ++i) in_front += scene.points.positions[3 * i + 2] > 0 ? 1 : 0;
  EXPECT_GT(in_front, 1200u);
  EXPECT_EQ(read_scene(options).points.positions, scene.points.positions);
  options.seed = 1;
  EXPECT_NE(read_scene(options).points.positions, scene.points.positions);
  options.random_points = 0;
  expect_contains(input_error_of([&] { read_scene(options); }), "no points");
}

TEST(ReadScene, NotesCoordinatesTooFarFromTheOriginForSinglePrecision) {
  const Row row;
  ColmapModel model = read_colmap_model(row.folder / "sparse/0");
  const auto noted = [&] {
    const Scene scene = read_scene(row.options());
    return std::ranges::any_of(
        scene.notes, [](const std::string& note) { return note.find("subtract an offset") != std::string::npos; });
  };
  EXPECT_FALSE(noted());
  for (ColmapImage& image : model.images) image.translation[0] -= 5e5;
  write_colmap_model(row.folder / "sparse/0", model);
  EXPECT_TRUE(noted());
}

TEST(ReadScene, PointsAtOnePlaceAreReplacedBecauseTheyHaveNoSize) {
  for (const int count : {1, 3}) {
    const Row row(std::vector<float>{});
    ColmapModel model = read_colmap_model(row.folder / "sparse/0");
    for (int i = 0; i < count; ++i) {
      for (const float coordinate : {1.0f, 2.0f, 3.0f}) model.points.positions.push_back(coordinate);
      model.points.colors.insert(model.points.colors.end(), 3, 100);
    }
    write_colmap_model(row.folder / "sparse/0", model);
    SceneOptions options = row.options();
    options.random_points = 50;
    const Scene scene = read_scene(options);
    EXPECT_EQ(scene.points.size(), 50u) << count;
    ASSERT_FALSE(scene.notes.empty());
    expect_contains(scene.notes.back(),
                    "at the same place, and too few could be triangulated from its photos; 50 random ones are used");
    EXPECT_TRUE(scene.lacks_points);
    options.random_points = 0;
    expect_contains(input_error_of([&] { read_scene(options); }), "at the same place, and random_points is 0");
  }
}

TEST(ReadScene, TellsWhatItLookedFor) {
  const TemporaryFolder folder;
  SceneOptions options;
  options.source = folder.path();
  const std::string message = input_error_of([&] { read_scene(options); });
  for (const char* part : {"sparse/0/cameras.bin", "transforms_train.json", "transforms.json"})
    expect_contains(message, part);
  expect_contains(message, folder.path().string());
  options.source = folder / "nowhere";
  expect_contains(input_error_of([&] { read_scene(options); }), "nowhere: does not exist");
  write_file(folder / "file", "x");
  options.source = folder / "file";
  expect_contains(input_error_of([&] { read_scene(options); }), "file: is neither a folder nor a packed scene");
  options.source.clear();
  expect_contains(input_error_of([&] { read_scene(options); }), "--source");
}

TEST(ReadScene, ReportsTheFirstOfSeveralBrokenPhotos) {
  const Row row;
  for (const char* name : {"v3.png", "v4.png", "v8.png"}) write_file(row.folder.path() / "images" / name, "broken");
  for (int i = 0; i < 5; ++i) {
    expect_contains(input_error_of([&] { read_scene(row.options()); }),
                    have_opencv() ? "v3.png: the image cannot be decoded" : "v3.png: the image is not a PNG");
  }
}

TEST(ReadScene, OpenCvStaysSilent) {
  const Row row;
  const std::string whole = read_file(row.folder / "images/v3.png");
  testing::internal::CaptureStderr();
  for (const std::string& content :
       {whole.substr(0, whole.size() - 20), std::string("BM broken bitmap"), std::string("\xff\xd8\xff\xe0 broken")}) {
    write_file(row.folder / "images/v3.png", content);
    expect_contains(input_error_of([&] { read_scene(row.options()); }), "v3.png: ");
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

// ------------------------------------------------------------------- shared data sets, skipped where they are missing

/// Fraction of the points that project into the image, in front of the camera.
double share_in_view(const Scene& scene, const Camera& camera) {
  std::size_t inside = 0;
  for (std::size_t i = 0; i < scene.points.size(); ++i) {
    const float* p = scene.points.positions.data() + 3 * i;
    const glm::vec4 q = camera.camera_from_world * glm::vec4(p[0], p[1], p[2], 1);
    const float x = camera.fx * q.x / q.z + camera.cx, y = camera.fy * q.y / q.z + camera.cy;
    const bool seen =
        q.z > 0 && x >= 0 && y >= 0 && x < static_cast<float>(camera.width) && y < static_cast<float>(camera.height);
    inside += seen ? 1 : 0;
  }
  return static_cast<double>(inside) / static_cast<double>(scene.points.size());
}

Scene read_shared(const std::filesystem::path& source, bool eval, int resolution) {
  SceneOptions options;
  options.source = source;
  options.eval = eval;
  options.resolution = resolution;
  return read_scene(options);
}

TEST(SharedData, Fox) {
  if (!have_opencv()) GTEST_SKIP() << "JPEG and resizing need OpenCV";
  const auto folder = shared_data("fox");
  if (folder.empty()) GTEST_SKIP() << "no fox";
  const Scene scene = read_shared(folder, true, 2);
  EXPECT_EQ(scene.train.size(), 43u);
  EXPECT_EQ(scene.test.size(), 7u);
  EXPECT_EQ(scene.points.size(), 12221u);
  EXPECT_EQ(scene.train[0].camera.width, 265);
  EXPECT_EQ(scene.train[0].camera.height, 473);
  for (const View& view : scene.train) EXPECT_GT(share_in_view(scene, view.camera), 0.2) << view.name;

  // libjpeg fills the missing part with grey and reports success.
  const TemporaryFolder scratch;
  const std::string whole = read_file(folder / "images/0001.jpg");
  Photo photo;
  photo.file = scratch / "cut.jpg";
  photo.lens.fx = 100;
  write_file(photo.file, whole);
  EXPECT_EQ(load_view(photo, {}).view.camera.width, 530);
  testing::internal::CaptureStderr();
  write_file(photo.file, whole.substr(0, whole.size() * 3 / 4));
  expect_contains(input_error_of([&] { load_view(photo, {}); }), "cut.jpg: the JPEG is cut short");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(SharedData, Fern) {
  if (!have_opencv()) GTEST_SKIP() << "JPEG and resizing need OpenCV";
  const auto folder = shared_data("fern");
  if (folder.empty()) GTEST_SKIP() << "no fern";
  const Scene scene = read_shared(folder, false, 4);
  EXPECT_EQ(scene.train.size(), 20u);
  EXPECT_EQ(scene.points.size(), 6410u);
  for (const View& view : scene.train) EXPECT_GT(share_in_view(scene, view.camera), 0.4) << view.name;
}

TEST(SharedData, DtuKeepsItsPrincipalPoint) {
  if (!have_opencv()) GTEST_SKIP() << "JPEG and resizing need OpenCV";
  const auto folder = shared_data("dtu_scan24");
  if (folder.empty()) GTEST_SKIP() << "no dtu_scan24";
  const Scene scene = read_shared(folder, false, 1);
  EXPECT_EQ(scene.train.size(), 49u);
  EXPECT_EQ(scene.points.size(), 6885u);
  EXPECT_NEAR(scene.train[0].camera.cx, 411.86, 0.5);  // not the image centre, 400
  for (const View& view : scene.train) EXPECT_GT(share_in_view(scene, view.camera), 0.4) << view.name;
}

TEST(SharedData, Lego) {
  if (!have_opencv()) GTEST_SKIP() << "JPEG and resizing need OpenCV";
  const auto folder = shared_data("lego");
  if (folder.empty()) GTEST_SKIP() << "no lego";
  Scene scene = read_shared(folder, true, -1);
  EXPECT_EQ(scene.train.size(), 100u);
  EXPECT_EQ(scene.test.size(), 50u);
  EXPECT_EQ(scene.train[0].camera.width, 400);
  EXPECT_NEAR(scene.train[0].camera.fx, 555.55, 0.1);
  EXPECT_NEAR(glm::length(scene.train[0].camera.centre()), 4.031, 0.01);
  EXPECT_NEAR(scene.extent, 1.1 * 4.4, 0.6);
  // All cameras look at the centre of the scene: the origin projects near the middle of every image.
  for (const View& view : scene.train) {
    const glm::vec4 origin = view.camera.camera_from_world[3];
    EXPECT_NEAR(origin.x / origin.z, 0, 0.02);
    EXPECT_NEAR(origin.z, 4.031, 0.01);
  }
  EXPECT_EQ(scene.train[0].color[0], 0);  // black behind the object
}

}  // namespace
}  // namespace splatboost::test
