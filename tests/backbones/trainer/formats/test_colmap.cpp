// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/colmap.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <utility>

#include <glm/geometric.hpp>
#include <glm/vec4.hpp>

#include "support/temporary_folder.h"
#include "trainer/formats/read_scene.h"
#include "trainer/images/image_codec.h"

namespace splatboost::test {
namespace {

constexpr int kWidth = 96, kHeight = 64;

/// Two photos of one pinhole camera with its principal point off the image centre.
ColmapModel make_model() {
  ColmapModel model;
  model.cameras.push_back({7, 1, kWidth, kHeight, {80, 82, 45.5, 33.25}});
  ColmapImage image;
  image.id = 1;
  image.camera_id = 7;
  image.name = "b.png";
  model.images.push_back(image);
  image.id = 2;
  image.name = "sub/a photo.png";
  const double half = 0.5 * std::numbers::pi / 6;
  const double rotation[4] = {2 * std::cos(half), 0, 2 * std::sin(half), 0};  // not normalised
  std::copy(std::begin(rotation), std::end(rotation), image.rotation);
  image.translation[0] = 0.5;
  image.translation[2] = -2;
  model.images.push_back(image);
  model.points.positions = {1, 2, 3, -0.125f, 0.1f, 7};
  model.points.colors = {255, 0, 1, 9, 8, 7};
  return model;
}

void write_grey(const std::filesystem::path& path, int width, int height, std::uint8_t value) {
  std::filesystem::create_directories(path.parent_path());
  const std::vector<std::uint8_t> pixels(static_cast<std::size_t>(width * height), value);
  write_png(path, width, height, 1, std::span<const std::uint8_t>(pixels));
}

/// A valid scene on disk, for tests to damage.
struct SceneOnDisk {
  TemporaryFolder folder;
  std::filesystem::path model_folder = folder / "sparse/0";

  explicit SceneOnDisk(const ColmapModel& model = make_model(), ColmapFormat format = ColmapFormat::binary) {
    std::filesystem::create_directories(model_folder);
    write_colmap_model(model_folder, model, format);
    for (const ColmapImage& image : model.images)
      write_grey(folder.path() / "images" / image.name, kWidth, kHeight, 100);
  }
  Scene read(const std::string& images = "images") const {
    SceneOptions options;
    options.source = folder.path();
    options.images = images;
    return read_scene(options);
  }
  std::string error() const {
    return input_error_of([&] { read(); });
  }
};

TEST(Colmap, BinaryAndTextGiveTheSameScene) {
  for (const ColmapFormat format : {ColmapFormat::binary, ColmapFormat::text}) {
    const SceneOnDisk disk(make_model(), format);
    EXPECT_TRUE(
        std::filesystem::exists(disk.model_folder / (format == ColmapFormat::text ? "cameras.txt" : "cameras.bin")));
    const Scene scene = disk.read();
    ASSERT_EQ(scene.train.size(), 2u);
    EXPECT_TRUE(scene.test.empty());
    EXPECT_EQ(scene.train[0].name, "b.png");
    EXPECT_EQ(scene.train[1].name, "sub/a photo.png");
    EXPECT_EQ(scene.points.positions, make_model().points.positions);
    EXPECT_EQ(scene.points.colors, make_model().points.colors);

    // The principal point is kept; the pose is that of the quaternion, 30 degrees about y.
    const Camera& camera = scene.train[1].camera;
    EXPECT_EQ(camera.width, kWidth);
    EXPECT_FLOAT_EQ(camera.fx, 80);
    EXPECT_FLOAT_EQ(camera.fy, 82);
    EXPECT_FLOAT_EQ(camera.cx, 45.5);
    EXPECT_FLOAT_EQ(camera.cy, 33.25);
    const glm::vec4 p = camera.camera_from_world * glm::vec4(1, 2, 3, 1);
    EXPECT_NEAR(p.x, std::cos(std::numbers::pi / 6) + 1.5 + 0.5, 1e-5);
    EXPECT_NEAR(p.y, 2, 1e-5);
    EXPECT_NEAR(p.z, -0.5 + 3 * std::cos(std::numbers::pi / 6) - 2, 1e-5);
    EXPECT_TRUE(scene.train[0].valid.empty());
    EXPECT_EQ(scene.train[0].color.size(), 3u * kWidth * kHeight);
    EXPECT_EQ(scene.train[0].color[1234], 100);
  }
}

TEST(Colmap, AlsoFindsAModelWithoutTheFolderZero) {
  SceneOnDisk disk;
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    std::filesystem::rename(disk.model_folder / name, disk.folder / "sparse" / name);
  }
  EXPECT_EQ(disk.read().train.size(), 2u);
}

TEST(Colmap, PointsMayBeMissing) {
  SceneOnDisk disk;
  std::filesystem::remove(disk.model_folder / "points3D.bin");
  SceneOptions options;
  options.source = disk.folder.path();
  options.random_points = 500;
  const Scene scene = read_scene(options);
  EXPECT_EQ(scene.points.size(), 500u);
  EXPECT_FALSE(scene.notes.empty());
}

TEST(Colmap, UniformlyScaledImagesScaleTheCamera) {
  const SceneOnDisk disk;
  for (const char* name : {"b.png", "sub/a photo.png"})
    write_grey(disk.folder / "images_4" / name, kWidth / 4, kHeight / 4, 50);
  const Camera camera = disk.read("images_4").train[0].camera;
  EXPECT_EQ(camera.width, kWidth / 4);
  EXPECT_EQ(camera.height, kHeight / 4);
  EXPECT_FLOAT_EQ(camera.fx, 20);
  EXPECT_FLOAT_EQ(camera.fy, 20.5);
  EXPECT_FLOAT_EQ(camera.cx, 45.5f / 4);
  EXPECT_FLOAT_EQ(camera.cy, 33.25f / 4);
  write_grey(disk.folder / "images_4/b.png", kWidth / 4, kHeight / 2, 50);
  const std::string message = input_error_of([&] { disk.read("images_4"); });
  expect_contains(message, "images_4/b.png");
  expect_contains(message, "24x32");
  expect_contains(message, "96x64");
  // Whatever its shape, a picture of a few pixels would fit after rounding.
  write_grey(disk.folder / "images_4/b.png", 1, 1, 50);
  expect_contains(input_error_of([&] { disk.read("images_4"); }), "is 1x1, a copy of a photo of 96x64");
}

TEST(Colmap, UndistortionPutsAKnownPointWhereThePinholeSeesIt) {
  if (!have_opencv()) GTEST_SKIP() << "undistortion needs OpenCV";
  struct Case {
    int model;
    std::vector<double> params;
    double fx, fy, cx, cy, k1, k2, p1, p2;
  };
  const std::vector<Case> cases{
      {2, {150, 101.5, 77.25, -0.2}, 150, 150, 101.5, 77.25, -0.2, 0, 0, 0},
      {3, {150, 101.5, 77.25, 0.15, -0.03}, 150, 150, 101.5, 77.25, 0.15, -0.03, 0, 0},
      {4, {150, 155, 101.5, 77.25, -0.15, 0.02, 0.01, -0.008}, 150, 155, 101.5, 77.25, -0.15, 0.02, 0.01, -0.008}};
  constexpr int kW = 200, kH = 150;
  for (const Case& test : cases) {
    for (const glm::dvec2 point : {glm::dvec2(0.35, -0.3), glm::dvec2(-0.42, 0.25), glm::dvec2(0.02, 0.01)}) {
      // The distorted image of the direction (x, y, 1), from the definition of the models.
      const double x = point.x, y = point.y, r2 = x * x + y * y;
      const double radial = 1 + test.k1 * r2 + test.k2 * r2 * r2;
      const double u = x * radial + 2 * test.p1 * x * y + test.p2 * (r2 + 2 * x * x);
      const double v = y * radial + 2 * test.p2 * x * y + test.p1 * (r2 + 2 * y * y);
      const double seen_x = test.fx * u + test.cx, seen_y = test.fy * v + test.cy;
      std::vector<std::uint8_t> pixels(kW * kH);
      for (int j = 0; j < kH; ++j) {
        for (int i = 0; i < kW; ++i) {
          const double d2 = std::pow(i + 0.5 - seen_x, 2) + std::pow(j + 0.5 - seen_y, 2);
          pixels[static_cast<std::size_t>(j * kW + i)] =
              static_cast<std::uint8_t>(std::lround(250 * std::exp(-d2 / 8)));
        }
      }
      ColmapModel model;
      model.cameras.push_back({1, test.model, kW, kH, test.params});
      ColmapImage image;
      image.camera_id = 1;
      image.name = "x.png";
      model.images.push_back(image);
      model.points = make_model().points;
      const SceneOnDisk disk(model);
      write_png(disk.folder / "images/x.png", kW, kH, 1, std::span<const std::uint8_t>(pixels));
      const Scene scene = disk.read();
      const View& view = scene.train.at(0);
      EXPECT_FLOAT_EQ(view.camera.fx, static_cast<float>(test.fx));
      EXPECT_FLOAT_EQ(view.camera.cy, static_cast<float>(test.cy));

      double sum = 0, sum_x = 0, sum_y = 0;
      for (int j = 0; j < kH; ++j) {
        for (int i = 0; i < kW; ++i) {
          const double value = view.color[static_cast<std::size_t>(j * kW + i)];
          sum += value;
          sum_x += value * (i + 0.5);
          sum_y += value * (j + 0.5);
        }
      }
      EXPECT_NEAR(sum_x / sum, test.fx * x + test.cx, 0.15) << "model " << test.model;
      EXPECT_NEAR(sum_y / sum, test.fy * y + test.cy, 0.15) << "model " << test.model;

      // A pincushion lens does not cover the corners of the pinhole image.
      const bool misses_corners = test.k1 > 0;
      EXPECT_EQ(!view.valid.empty(), misses_corners);
      if (misses_corners) {
        EXPECT_EQ(view.valid.front(), 0);
        EXPECT_NE(view.valid[static_cast<std::size_t>(kH / 2 * kW + kW / 2)], 0);
      }
    }
  }
}

TEST(Colmap, AFoldedLensLeavesNoGhosts) {
  if (!have_opencv()) GTEST_SKIP() << "undistortion needs OpenCV";
  // 1 + 3 k1 r² crosses zero at r = 0.745, inside the image: the distortion folds back there, and pixels beyond are
  // invalid.
  ColmapModel model = make_model();
  model.cameras[0] = {7, 2, kWidth, kHeight, {48, 48, 32, -0.6}};
  const SceneOnDisk disk(model);
  const Scene scene = disk.read();
  const View& view = scene.train[0];
  ASSERT_FALSE(view.valid.empty());
  const auto valid_at = [&](int x, int y) { return view.valid[static_cast<std::size_t>(y * kWidth + x)] != 0; };
  EXPECT_TRUE(valid_at(48, 32));
  EXPECT_TRUE(valid_at(48 + 33, 32));   // r = 0.70
  EXPECT_FALSE(valid_at(48 + 38, 32));  // r = 0.80
  EXPECT_FALSE(valid_at(0, 0));
}

TEST(Colmap, ADistortionThatLeavesNothingIsRefused) {
  if (!have_opencv()) GTEST_SKIP() << "undistortion needs OpenCV";
  ColmapModel model = make_model();
  model.cameras[0] = {7, 2, kWidth, kHeight, {48, 48, 32, 1e9}};
  const SceneOnDisk disk(model);
  const std::string line = input_error_of([&] { disk.read(); });
  expect_contains(line, "undistorting it leaves");
  expect_contains(line, "check the distortion of its camera in");
}

TEST(Colmap, EveryTruncationIsAnInputErrorThatNamesTheFile) {
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    const SceneOnDisk disk;
    const std::string whole = read_file(disk.model_folder / name);
    for (std::size_t size = 0; size < whole.size(); ++size) {
      write_file(disk.model_folder / name, whole.substr(0, size));
      expect_contains(input_error_of([&] { read_colmap_model(disk.model_folder); }),
                      std::string(name) + ": is cut short");
    }
  }
}

/// A damaged count would drop records without a word.
TEST(Colmap, BytesAfterTheLastRecordAreDamage) {
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    const SceneOnDisk disk;
    const std::string whole = read_file(disk.model_folder / name);
    for (const std::string& damaged : {whole + '\0', std::string(8, '\0') + whole.substr(8)}) {
      write_file(disk.model_folder / name, damaged);
      expect_contains(input_error_of([&] { read_colmap_model(disk.model_folder); }),
                      std::string(name) + ": is damaged: bytes follow its end");
    }
  }
}

TEST(Colmap, ImpossibleCountsAreNoticedBeforeAllocation) {
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    const SceneOnDisk disk;
    std::string content = read_file(disk.model_folder / name);
    const std::uint64_t count = 1ull << 60;
    std::memcpy(content.data(), &count, sizeof(count));
    write_file(disk.model_folder / name, content);
    const std::string message = disk.error();
    expect_contains(message, name);
    expect_contains(message, "1152921504606846976");
  }
}

TEST(Colmap, UnknownModelsAreNamedWithThoseSupported) {
  ColmapModel model = make_model();
  model.cameras[0].model = 5;
  model.cameras[0].params.resize(8);
  for (const ColmapFormat format : {ColmapFormat::binary, ColmapFormat::text}) {
    const std::string message = SceneOnDisk(model, format).error();
    for (const char* part : {"cameras.", "OPENCV_FISHEYE", "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV"}) {
      expect_contains(message, part);
    }
  }
  model.cameras[0].model = 77;
  expect_contains(SceneOnDisk(model).error(), "number 77");
}

TEST(Colmap, CamerasWithoutImagesMayBeOfAnyModel) {
  for (const ColmapFormat format : {ColmapFormat::binary, ColmapFormat::text}) {
    ColmapModel model = make_model();
    model.cameras.push_back({8, 5, kWidth, kHeight, std::vector<double>(8, 1.0)});  // OPENCV_FISHEYE
    model.cameras.push_back({9, 1, 0, 0, std::vector<double>(4, 0.0)});             // never calibrated
    EXPECT_EQ(SceneOnDisk(model, format).read().train.size(), model.images.size());
    model.images[0].camera_id = 8;
    expect_contains(SceneOnDisk(model, format).error(), "camera 8 has the model OPENCV_FISHEYE");
    model.images[0].camera_id = 9;
    expect_contains(SceneOnDisk(model, format).error(), "camera 9: the image size is zero");
  }
}

TEST(Colmap, ACameraListedTwiceIsRefused) {
  ColmapModel model = make_model();
  model.cameras.push_back(model.cameras[0]);
  expect_contains(SceneOnDisk(model).error(), "cameras.bin: lists camera 7 twice");
}

TEST(Colmap, CamerasAndPosesThatCannotBeAreNamed) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto error_after = [](auto&& change, ColmapFormat format = ColmapFormat::binary) {
    ColmapModel model = make_model();
    change(model);
    return SceneOnDisk(model, format).error();
  };
  for (const ColmapFormat format : {ColmapFormat::binary, ColmapFormat::text}) {
    const std::string message = error_after([&](ColmapModel& m) { m.images[1].translation[1] = nan; }, format);
    expect_contains(message, "images.");
    expect_contains(message, "sub/a photo.png");
    expect_contains(error_after([&](ColmapModel& m) { m.cameras[0].params[0] = nan; }, format),
                    "camera 7: the focal length");
  }
  expect_contains(error_after([&](ColmapModel& m) { m.images[0].rotation[2] = INFINITY; }), "rotation is not finite");
  expect_contains(error_after([&](ColmapModel& m) { m.images[0].rotation[0] = 0; }), "quaternion is zero");
  expect_contains(error_after([&](ColmapModel& m) { m.images[0].rotation[0] = 1e200; }),
                  "quaternion is far longer than 1");
  for (const double far : {3e38, -2e12}) {
    expect_contains(error_after([&](ColmapModel& m) { m.images[0].translation[2] = far; }),
                    "units away from the origin, farther than 1e+12");
  }
  expect_contains(error_after([&](ColmapModel& m) { m.points.positions[4] = 1e20f; }), "point 1 is 1e+20 units away");
  expect_contains(error_after([&](ColmapModel& m) { m.images[0].camera_id = 3; }), "refers to camera 3");
  expect_contains(error_after([&](ColmapModel& m) { m.cameras[0].params[1] = 0; }), "focal length");
  expect_contains(error_after([&](ColmapModel& m) { m.cameras[0].params[1] = -5; }), "focal length");
  expect_contains(error_after([&](ColmapModel& m) { m.cameras[0].params[2] = INFINITY; }), "principal point");
  expect_contains(error_after([&](ColmapModel& m) { m.cameras[0].width = 0; }), "image size is zero");
  expect_contains(error_after([&](ColmapModel& m) { m.cameras[0].width = 1ull << 40; }), "not possible");
  expect_contains(error_after([&](ColmapModel& m) { m.points.positions[4] = NAN; }), "points3D.bin");
  expect_contains(error_after([&](ColmapModel& m) { m.images.clear(); }), "lists no images");
}

TEST(Colmap, PointsFarAwayAreNamedWithTheirFile) {
  ColmapModel model = make_model();
  model.points.positions[4] = 1e20f;
  for (const auto& [format, name] :
       {std::pair(ColmapFormat::binary, "points3D.bin"), std::pair(ColmapFormat::text, "points3D.txt")}) {
    const SceneOnDisk disk(model, format);
    expect_contains(disk.error(), (disk.model_folder / name).string() + ": point 1 is 1e+20 units away");
    std::filesystem::remove(disk.model_folder / name);
    write_file(disk.model_folder / "points3D.ply",
               "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
               "end_header\n0 0 -4e13\n");
    expect_contains(disk.error(), (disk.model_folder / "points3D.ply").string() + ": point 0 is 4e+13 units away");
  }
}

TEST(Colmap, BrokenTextIsNamedByLine) {
  const SceneOnDisk disk(make_model(), ColmapFormat::text);
  write_file(disk.model_folder / "cameras.txt", "# comment\n7 PINHOLE 96 sixty 80 82 45 33\n");
  std::string message = disk.error();
  expect_contains(message, "cameras.txt: line 2");
  expect_contains(message, "sixty");
  write_file(disk.model_folder / "cameras.txt", "7 PINHOLE 96 64 80 82 45\n");
  expect_contains(disk.error(), "cameras.txt: line 1 has no camera parameter");
  write_file(disk.model_folder / "cameras.txt", "7 PINHOLE 96 64 80 82 45 33 9\n");
  expect_contains(disk.error(), "too many");
}

TEST(Colmap, TextMayBeginWithAByteOrderMark) {
  const SceneOnDisk disk(make_model(), ColmapFormat::text);
  for (const char* name : {"cameras.txt", "images.txt", "points3D.txt"}) {
    write_file(disk.model_folder / name, "\xef\xbb\xbf" + read_file(disk.model_folder / name));
  }
  const Scene scene = disk.read();
  EXPECT_EQ(scene.train.size(), make_model().images.size());
  EXPECT_EQ(scene.points.positions, make_model().points.positions);
}

TEST(Colmap, AListOfPointsThatIsLeftOutIsNoticed) {
  // Every second image line would be parsed as the points of the image before.
  const SceneOnDisk disk(make_model(), ColmapFormat::text);
  const std::filesystem::path file = disk.model_folder / "images.txt";
  const std::string whole = read_file(file);
  std::string without;
  for (std::size_t at = 0; at < whole.size(); ++at) {
    if (whole[at] == '\n' && at + 1 < whole.size() && whole[at + 1] == '\n') continue;
    without += whole[at];
  }
  ASSERT_LT(without.size(), whole.size());
  write_file(file, without);
  const std::string message = disk.error();
  expect_contains(message, "images.txt: line 4 is not the list of 2D points of image");
  expect_contains(message, "every image takes two lines");
  // Lists of 2D points as COLMAP writes them.
  std::string with_points = whole;
  for (std::size_t at = 0; (at = with_points.find("\n\n", at)) != std::string::npos;) {
    with_points.insert(at + 1, "1.5 2 -1 30.25 1e1 7 ");
  }
  write_file(file, with_points);
  EXPECT_EQ(disk.read().train.size(), make_model().images.size());
}

TEST(Colmap, BrokenImagesAreNamed) {
  const SceneOnDisk disk;
  const std::filesystem::path image = disk.folder / "images/b.png";
  const std::string whole = read_file(image);
  std::filesystem::remove(image);
  std::string message = disk.error();
  expect_contains(message, "images/b.png: the image does not exist");
  expect_contains(message, "images.bin");
  write_file(image, "");
  expect_contains(disk.error(), "b.png: the image is empty");
  write_file(image, "this is no image at all");
  expect_contains(disk.error(), have_opencv() ? "b.png: the image cannot be decoded" : "b.png: the image is not a PNG");
  write_file(image, whole.substr(0, whole.size() / 2));
  expect_contains(disk.error(), "b.png: the PNG is cut short");
  std::string flipped = whole;
  flipped[flipped.size() / 2] = static_cast<char>(flipped[flipped.size() / 2] ^ 0x55);
  write_file(image, flipped);
  expect_contains(disk.error(), "b.png: the PNG is ");
  write_file(image, whole);
  write_grey(image, kWidth, kHeight / 2, 1);
  expect_contains(disk.error(), "b.png: is 96x32");
  std::filesystem::remove_all(disk.folder / "images");
  message = disk.error();
  expect_contains(message, "images: the image folder does not exist");
  expect_contains(message, "--images");
}

}  // namespace
}  // namespace splatboost::test
