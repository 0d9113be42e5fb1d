// SPDX-License-Identifier: Apache-2.0
// Dynamic scenes: captures of Nerfies and HyperNeRF, multi-view videos, COLMAP with frame numbers, and the detection of
// the format of a folder.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/vec4.hpp>
#include <nlohmann/json.hpp>

#include "support/temporary_folder.h"
#include "trainer/formats/colmap.h"
#include "trainer/formats/frame_times.h"
#include "trainer/formats/nerfies.h"
#include "trainer/formats/neural_video.h"
#include "trainer/formats/npy.h"
#include "trainer/formats/read_scene.h"
#include "trainer/images/image_codec.h"
#include "trainer/images/video.h"
#include "trainer/points/initial_points.h"

namespace splatboost::test {
namespace {

using Json = nlohmann::json;

constexpr int kWidth = 40, kHeight = 24;

template <class T>
std::string npy_bytes(const std::string& type, const std::string& shape, const std::vector<T>& values,
                      const std::string& order = "False") {
  std::string header = "{'descr': '" + type + "', 'fortran_order': " + order + ", 'shape': " + shape + ", }";
  header.append(64 - (10 + header.size() + 1) % 64, ' ');
  header += '\n';
  std::string bytes("\x93NUMPY\x01\x00", 8);
  bytes += static_cast<char>(header.size() & 0xff);
  bytes += static_cast<char>(header.size() >> 8);
  bytes += header;
  bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  return bytes;
}

void write_grey(const std::filesystem::path& path, int level) {
  std::filesystem::create_directories(path.parent_path());
  const std::vector<std::uint8_t> pixels(3 * kWidth * kHeight, static_cast<std::uint8_t>(level));
  write_png(path, kWidth, kHeight, 3, std::span<const std::uint8_t>(pixels));
}

/// A static COLMAP model: one photo.
void write_still_model(const std::filesystem::path& folder) {
  ColmapModel model;
  model.cameras.push_back({1, 1, kWidth, kHeight, {30, 30, 20, 12}});
  ColmapImage image;
  image.id = image.camera_id = 1;
  image.name = "still.png";
  model.images.push_back(image);
  model.points.positions = {0, 0, 3};
  model.points.colors = {9, 9, 9};
  std::filesystem::create_directories(folder / "sparse/0");
  write_colmap_model(folder / "sparse/0", model);
  write_grey(folder / "images/still.png", 50);
}

SceneOptions options_of(const TemporaryFolder& folder) {
  SceneOptions options;
  options.source = folder.path();
  options.eval = true;
  options.random_points = 10;
  return options;
}

TEST(Npy, ArraysReadAsWritten) {
  const TemporaryFolder folder;
  write_file(folder / "d.npy", npy_bytes<double>("<f8", "(2, 3)", {1, 2, 3, 4, 5, 6.5}));
  write_file(folder / "f.npy", npy_bytes<float>("<f4", "(3,)", {1, -2, 0.5f}));
  const NpyArray d = read_npy(folder / "d.npy"), f = read_npy(folder / "f.npy");
  EXPECT_EQ(d.shape, (std::vector<std::size_t>{2, 3}));
  EXPECT_EQ(d.values, (std::vector<double>{1, 2, 3, 4, 5, 6.5}));
  EXPECT_EQ(f.shape, (std::vector<std::size_t>{3}));
  EXPECT_EQ(f.values, (std::vector<double>{1, -2, 0.5}));
}

TEST(Npy, BrokenOnesAreToldInOneLine) {
  const TemporaryFolder folder;
  const auto error = [&](const std::string& bytes) {
    write_file(folder / "a.npy", bytes);
    return input_error_of([&] { read_npy(folder / "a.npy"); });
  };
  const std::string good = npy_bytes<double>("<f8", "(2, 3)", {1, 2, 3, 4, 5, 6});
  expect_contains(error("nothing"), "is not a NumPy array file");
  for (std::size_t cut = 12; cut < good.size(); cut += 7) error(good.substr(0, cut));
  expect_contains(error(npy_bytes<double>("<i8", "(1,)", {1})), "floats");
  expect_contains(error(npy_bytes<double>("<f8", "(1,)", {1}, "True")), "column-major order");
  expect_contains(error(npy_bytes<double>("<f8", "(99999999999, 99999999999)", {1})), "out of range");
  expect_contains(error(npy_bytes<double>("<f8", "(1, 1, 1)", {1})), "3 dimensions");
  expect_contains(error(npy_bytes<double>("<f8", "(1, x)", {1})), "cannot be read");
}

/// Eight photos: camera i at (i, 0, -4) of a world centred at (1, 0, 0) and scaled by 2.
struct Capture {
  TemporaryFolder folder;
  Json dataset{{"ids", Json::array()}, {"train_ids", Json::array()}, {"val_ids", Json::array()}};
  Capture() {
    Json metadata;
    for (int i = 0; i < 8; ++i) {
      const std::string id = "00" + std::to_string(i);
      dataset["ids"].push_back(id);
      dataset[i % 3 == 2 ? "val_ids" : "train_ids"].push_back(id);
      metadata[id] = {{"time_id", 10 + 3 * i}, {"camera_id", 0}, {"warp_id", 77}};
      const Json camera{{"orientation", {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}},
                        {"position", {i, 0, -4}},
                        {"focal_length", 60},
                        {"pixel_aspect_ratio", 1.0},
                        {"principal_point", {41, 24}},
                        {"skew", 0},
                        {"radial_distortion", {0, 0, 0}},
                        {"tangential_distortion", {0, 0}},
                        {"image_size", {2 * kWidth, 2 * kHeight}}};
      write_file(folder / ("camera/" + id + ".json"), camera.dump());
      write_grey(folder / ("rgb/2x/" + id + ".png"), 20 * i);
    }
    write_file(folder / "dataset.json", dataset.dump());
    write_file(folder / "metadata.json", metadata.dump());
    write_file(folder / "scene.json", R"({"scale": 2, "center": [1, 0, 0], "near": 0.1, "far": 9})");
    write_file(folder / "points.npy", npy_bytes<double>("<f8", "(2, 3)", {1.5, 2, 3, 1, 2, 3}));
  }
  SceneOptions options() const {
    SceneOptions result = options_of(folder);
    result.images = "rgb/2x";
    return result;
  }
};

TEST(Nerfies, CapturesReadAsWritten) {
  const Capture disk;
  const Scene scene = read_scene(disk.options());
  ASSERT_EQ(scene.train.size(), 6u);
  ASSERT_EQ(scene.test.size(), 2u);
  EXPECT_EQ(scene.train[0].name, "000.png");
  EXPECT_EQ(scene.test[1].name, "005.png");
  EXPECT_FLOAT_EQ(scene.test[1].time, 5.0f / 7);
  EXPECT_FLOAT_EQ(scene.train.back().time, 1);
  const Camera& camera = scene.test[1].camera;
  EXPECT_FLOAT_EQ(camera.fx, 30) << "of pictures of half the size";
  EXPECT_FLOAT_EQ(camera.cx, 20.5f);
  EXPECT_NEAR(glm::length(camera.centre() - glm::vec3(8, 0, -8)), 0, 1e-5);
  const glm::vec4 ahead = camera.camera_from_world * glm::vec4(8, 1, 0, 1);
  EXPECT_NEAR(glm::length(glm::vec3(ahead) - glm::vec3(0, 1, 8)), 0, 1e-5) << "y points down";
  EXPECT_EQ(scene.points.positions, (std::vector<float>{1, 4, 6, 0, 4, 6}));
  EXPECT_FALSE(scene.synthetic);
}

TEST(Nerfies, OptionsWithoutEffectAreNamed) {
  const Capture disk;
  SceneOptions options = disk.options();
  EXPECT_EQ(read_scene(options).notes, std::vector<std::string>{});
  options.frames = 2;
  options.frame_times = true;
  const Scene scene = read_scene(options);
  ASSERT_EQ(scene.notes.size(), 2u);
  expect_contains(scene.notes[0], "--frames has no effect");
  expect_contains(scene.notes[1], "--frame-times has no effect");
}

TEST(Nerfies, InterpolationScenesHoldOutEveryFourth) {
  Capture disk;
  disk.dataset["val_ids"] = Json::array();
  write_file(disk.folder / "dataset.json", disk.dataset.dump());
  const Scene scene = read_scene(disk.options());
  ASSERT_EQ(scene.train.size(), 2u);
  ASSERT_EQ(scene.test.size(), 2u);
  EXPECT_EQ(scene.train[1].name, "004.png");
  EXPECT_EQ(scene.test[1].name, "006.png");
}

TEST(Nerfies, BrokenCapturesAreToldInOneLine) {
  const auto error = [](const char* file, const std::string& content) {
    const Capture disk;
    write_file(disk.folder / file, content);
    return input_error_of([&] { read_scene(disk.options()); });
  };
  expect_contains(error("scene.json", R"({"scale": 0, "center": [1, 0, 0]})"), "'scale' must be above 0");
  expect_contains(error("scene.json", R"({"scale": 1})"), "'center' is missing");
  expect_contains(error("dataset.json", R"({"train_ids": ["../x"], "val_ids": ["000"]})"), "not the name of an image");
  expect_contains(error("dataset.json", R"({"train_ids": [], "val_ids": ["000"]})"), "lists no images");
  expect_contains(error("metadata.json", R"({"000": {"time_id": 1}})"), "has no entry for image '001'");
  expect_contains(error("camera/001.json", R"({"focal_length": 3})"), "is missing");
  expect_contains(error("points.npy", "none"), "points.npy");
  expect_contains(error("dataset.json", R"({"train_ids": ["001", "001"], "val_ids": ["000"]})"),
                  "dataset.json: lists the image '001.png' twice");
  expect_contains(error("points.npy", npy_bytes<double>("<f8", "(1, 3)", {1, 2, 3e20})),
                  "points.npy: point 0 is 6e+20 units away");
  const Capture disk;
  SceneOptions options = disk.options();
  options.images.reset();
  expect_contains(input_error_of([&] { read_scene(options); }), "rgb/1x: the image folder does not exist");
}

/// Three cameras at x = 0, 1, 2 that look along −z of OpenGL's world, with five frames each; each pair (camera, frame)
/// has its own grey level.
struct Rig {
  TemporaryFolder folder;
  explicit Rig(bool videos = false) {
    std::vector<double> rows;
    for (int camera = 0; camera < 3; ++camera) {
      // Columns of the matrix: down, right, back, centre, size.
      const double x = camera;
      rows.insert(rows.end(), {0, 1, 0, x, kHeight, -1, 0, 0, 0, kWidth, 0, 0, 1, 5, 33, 0.1, 9});
      const std::string name = "cam0" + std::to_string(camera);
      if (videos) {
        VideoFile video(folder / (name + ".mp4"), kWidth, kHeight, 10);
        for (int frame = 0; frame < 5; ++frame) {
          video.add(std::vector<float>(3 * kWidth * kHeight, static_cast<float>(level(camera, frame)) / 255));
        }
        video.finish();
      } else {
        for (int frame = 0; frame < 5; ++frame) {
          write_grey(folder / (name + "/images/000" + std::to_string(frame) + ".png"), level(camera, frame));
        }
      }
    }
    write_file(folder / "poses_bounds.npy", npy_bytes<double>("<f8", "(3, 17)", rows));
  }
  static int level(int camera, int frame) { return 40 + 60 * camera + 12 * frame; }
};

void expect_rig(const Scene& scene, int tolerance) {
  ASSERT_EQ(scene.train.size(), 10u);
  ASSERT_EQ(scene.test.size(), 5u) << "the first camera";
  for (int camera = 0; camera < 3; ++camera) {
    for (int frame = 0; frame < 5; ++frame) {
      const auto f = static_cast<std::size_t>(frame);
      const View& view = camera == 0 ? scene.test[f] : scene.train[5 * (static_cast<std::size_t>(camera) - 1) + f];
      EXPECT_FLOAT_EQ(view.time, static_cast<float>(frame) / 4);
      EXPECT_NEAR(view.camera.centre().x, camera, 1e-5);
      EXPECT_NEAR(view.color[100], Rig::level(camera, frame), tolerance) << camera << " " << frame;
    }
  }
  const glm::vec4 p = scene.test[0].camera.camera_from_world * glm::vec4(0.5, 0.25, 1, 1);
  EXPECT_NEAR(glm::length(glm::vec3(p) - glm::vec3(0.5, -0.25, 4)), 0, 1e-5);
  EXPECT_FLOAT_EQ(scene.test[0].camera.fx, 33);
}

TEST(NeuralVideo, FoldersOfFramesReadAsWritten) {
  const Rig disk;
  expect_rig(read_scene(options_of(disk.folder)), 0);
  SceneOptions options = options_of(disk.folder);
  options.frames = 2;
  const Scene scene = read_scene(options);
  EXPECT_EQ(scene.train.size(), 4u);
  EXPECT_FLOAT_EQ(scene.train[1].time, 1);
  ASSERT_FALSE(scene.notes.empty());
  expect_contains(scene.notes[0], "the first 2 of 5 frames");
}

/// A missing picture used to shift the times of those after it.
TEST(NeuralVideo, TimesAreThoseOfTheNumbersInNames) {
  const Rig disk;
  std::filesystem::remove(disk.folder / "cam01/images/0002.png");
  const auto times_of = [](const Scene& scene, const std::string& camera) {
    std::vector<float> times;
    for (const View& view : scene.train) {
      if (view.name.starts_with(camera)) times.push_back(view.time);
    }
    return times;
  };
  const std::string lacks = (disk.folder / "cam01").string() + ": has no picture of the frame that ";
  Scene scene = read_scene(options_of(disk.folder));
  EXPECT_EQ(times_of(scene, "cam01/"), (std::vector<float>{0, 0.25f, 0.75f, 1}));
  EXPECT_EQ(times_of(scene, "cam02/"), (std::vector<float>{0, 0.25f, 0.5f, 0.75f, 1}));
  EXPECT_EQ(scene.notes.at(0), lacks + "cam00/images/0002.png shows; training uses the pictures that exist");

  std::filesystem::remove(disk.folder / "cam02/images/0003.png");
  SceneOptions options = options_of(disk.folder);
  options.frames = 4;
  scene = read_scene(options);
  EXPECT_EQ(times_of(scene, "cam01/"), (std::vector<float>{0, 1.0f / 3, 1}));
  EXPECT_EQ(times_of(scene, "cam02/"), (std::vector<float>{0, 1.0f / 3, 2.0f / 3}));
  expect_contains(scene.notes.at(0), "the first 4 of 5 frames");
  expect_contains(scene.notes.at(1), lacks + "cam00/images/0002.png shows (and 1 more picture is missing); ");
  options.frames = 2;
  EXPECT_EQ(read_scene(options).notes.size(), 2u) << "what was not asked for is not missed";

  // Numbers may begin anywhere and leave out frames, as of every tenth.
  const Rig tenths;
  for (int camera = 0; camera < 3; ++camera) {
    for (int frame = 4; frame >= 0; --frame) {
      const std::string images = "cam0" + std::to_string(camera) + "/images/";
      std::filesystem::rename(tenths.folder / (images + "000" + std::to_string(frame) + ".png"),
                              tenths.folder / (images + "shot" + std::to_string(10 * frame + 7) + ".png"));
    }
  }
  expect_rig(read_scene(options_of(tenths.folder)), 0);
}

TEST(NeuralVideo, AFolderOfFramesAgreesWithVideos) {
  if (!have_opencv()) GTEST_SKIP() << "no OpenCV";
  const Rig disk(true);
  std::filesystem::remove(disk.folder / "cam01.mp4");
  for (int frame = 0; frame < 5; ++frame) {  // tools that extract frames count from 1
    write_grey(disk.folder / ("cam01/" + std::to_string(frame + 1) + ".png"), Rig::level(1, frame));
  }
  expect_rig(read_scene(options_of(disk.folder)), 6);
}

TEST(NeuralVideo, WithoutNumbersEachCameraHasAsManyPictures) {
  const Rig disk;
  for (const char* camera : {"cam00", "cam01", "cam02"}) {  // the last number is not that of the frame
    for (int frame = 0; frame < 5; ++frame) {
      const std::filesystem::path images = disk.folder / camera / "images";
      std::filesystem::rename(images / ("000" + std::to_string(frame) + ".png"),
                              images / ("000" + std::to_string(frame) + "_" + camera + ".png"));
    }
  }
  write_file(disk.folder / "cam01/images/._0002_cam01.png", "of an archive made on macOS");
  expect_rig(read_scene(options_of(disk.folder)), 0);
  std::filesystem::remove(disk.folder / "cam01/images/0002_cam01.png");
  const std::string message = input_error_of([&] { read_scene(options_of(disk.folder)); });
  expect_contains(message, "cam01: holds 4 pictures, but cam00 holds 5; add the missing ones");
}

TEST(NeuralVideo, AFolderWithoutTheFirstFramesIsRefused) {
  const Rig disk;
  for (int frame = 0; frame < 3; ++frame) {
    std::filesystem::remove(disk.folder / ("cam02/images/000" + std::to_string(frame) + ".png"));
  }
  SceneOptions options = options_of(disk.folder);
  options.frames = 3;
  expect_contains(input_error_of([&] { read_scene(options); }),
                  "cam02: holds none of the first 3 frames of the other cameras; use --frames for more");
}

/// Rows of poses_bounds.npy are in the order of the names as text, as the tools that write the file list the cameras.
TEST(NeuralVideo, CamerasAreInTheOrderOfTheirNamesAsText) {
  const Rig disk;
  for (const auto& [from, to] : {std::pair("cam00", "cam1"), std::pair("cam01", "cam10"), std::pair("cam02", "cam2")}) {
    std::filesystem::rename(disk.folder / from, disk.folder / to);
  }
  const Scene scene = read_scene(options_of(disk.folder));
  expect_rig(scene, 0);
  EXPECT_EQ(scene.test[0].name, "cam1/0000.png");
  EXPECT_EQ(scene.train[0].name, "cam10/0000.png");
  EXPECT_EQ(scene.train[5].name, "cam2/0000.png");
}

TEST(NeuralVideo, ExtensionsMayBeInCapitals) {
  const Rig disk;
  for (int frame = 0; frame < 5; ++frame) {
    const std::filesystem::path file = disk.folder / ("cam01/images/000" + std::to_string(frame) + ".png");
    std::filesystem::rename(file, std::filesystem::path(file).replace_extension(".PNG"));
  }
  expect_rig(read_scene(options_of(disk.folder)), 0);
  if (!have_opencv()) GTEST_SKIP() << "no OpenCV";
  const Rig videos(true);
  std::filesystem::rename(videos.folder / "cam01.mp4", videos.folder / "cam01.MP4");
  expect_rig(read_scene(options_of(videos.folder)), 6);
}

TEST(NeuralVideo, VideosReadAsWritten) {
  if (!have_opencv()) GTEST_SKIP() << "no OpenCV";
  const Rig disk(true);
  expect_rig(read_scene(options_of(disk.folder)), 6);
  // Tools that extract frames leave such folders when they are stopped.
  std::filesystem::create_directories(disk.folder / "cam01/images");
  expect_rig(read_scene(options_of(disk.folder)), 6);
  write_file(disk.folder / "cam01.mp4", "no video");
  expect_contains(input_error_of([&] { read_scene(options_of(disk.folder)); }), "cam01.mp4: ");
}

/// Makes the last frames of a video unreadable, without changing the frame count in its container.
void damage_last_frames(const std::filesystem::path& video) {
  std::string bytes = read_file(video);
  const std::size_t media = bytes.find("mdat");
  ASSERT_NE(media, std::string::npos);
  std::size_t size = 0;  // of the box, which begins four bytes before its name
  for (std::size_t i = 0; i < 4; ++i) size = 256 * size + static_cast<std::uint8_t>(bytes[media - 4 + i]);
  const std::size_t end = media - 4 + size, whole = measure_video(video, 0).readable;
  for (std::size_t damaged = 1; measure_video(video, 0).readable == whole; ++damaged) {
    ASSERT_LT(damaged, size / 2);
    bytes[end - damaged] = '\0';
    if (damaged % 10 == 0) write_file(video, bytes);
  }
}

TEST(NeuralVideo, FramesThatCannotBeReadAreLeftOutWithALine) {
  if (!have_opencv()) GTEST_SKIP() << "no OpenCV";
  const Rig disk(true);
  damage_last_frames(disk.folder / "cam02.mp4");
  const VideoLength length = measure_video(disk.folder / "cam02.mp4", 0);
  ASSERT_EQ(length.claimed, 5u);
  ASSERT_LT(length.readable, 5u);
  ASSERT_GE(length.readable, 1u);
  EXPECT_EQ(measure_video(disk.folder / "cam02.mp4", 1).readable, 1u);
  EXPECT_EQ(measure_video(disk.folder / "cam01.mp4", 0).readable, 5u);

  for (const int frames : {0, 5, 24}) {
    SceneOptions options = options_of(disk.folder);
    options.frames = frames;
    const Scene scene = read_scene(options);
    EXPECT_EQ(scene.test.size(), 5u);
    ASSERT_EQ(scene.train.size(), 5u + length.readable);
    EXPECT_FLOAT_EQ(scene.train.back().time, static_cast<float>(length.readable - 1) / 4) << "by those of the others";
    ASSERT_EQ(scene.notes.size(), 2u) << "and one on points";
    EXPECT_EQ(scene.notes[0], "cam02.mp4 declares 5 frames, but only " + std::to_string(length.readable) +
                                  " can be read; training uses the readable frames");
  }
  SceneOptions options = options_of(disk.folder);
  options.frames = 1;
  const Scene scene = read_scene(options);
  EXPECT_EQ(scene.train.size(), 2u);
  expect_contains(scene.notes.at(0), "the first 1 of 5 frames");
  EXPECT_EQ(scene.notes.size(), 2u) << "what was not asked for is not missed";

  damage_last_frames(disk.folder / "cam01.mp4");
  options.frames = 0;
  expect_contains(read_scene(options).notes.at(0), "(and 1 more videos are also shorter than declared)");
}

TEST(NeuralVideo, OptionsWithoutEffectAreNamed) {
  const Rig disk;
  SceneOptions options = options_of(disk.folder);
  options.frames = 5;
  options.images = "images";
  options.frame_times = true;
  const auto expect_notes = [&] {
    const Scene scene = read_scene(options);
    ASSERT_EQ(scene.notes.size(), 3u) << "and one on points";
    expect_contains(scene.notes[0], "--images has no effect");
    expect_contains(scene.notes[1], "--frame-times has no effect");
  };
  expect_notes();
  pack_scene(options, disk.folder / "rig.sbscene");
  options.source = disk.folder / "rig.sbscene";
  expect_notes();
}

TEST(NeuralVideo, PointsFarAwayAreNamedWithTheirFile) {
  const Rig disk;
  write_file(disk.folder / "points3D.ply",
             "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
             "end_header\n0 0 4e13\n");
  expect_contains(input_error_of([&] { read_scene(options_of(disk.folder)); }), "points3D.ply: point 0 is 4e+13");
}

TEST(NeuralVideo, CamerasAndPosesMustAgree) {
  const Rig disk;
  write_grey(disk.folder / "cam07/0000.png", 3);
  expect_contains(input_error_of([&] { read_scene(options_of(disk.folder)); }),
                  "holds 3 cameras, but there are 4 videos or folders");
}

// Packed dynamic scenes.

/// Reads a packed scene with the options of its folder.
Scene read_packed(SceneOptions options, const std::filesystem::path& file) {
  options.source = file;
  return read_scene(options);
}

void expect_same_times(const std::vector<View>& a, const std::vector<View>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].name, b[i].name);
    EXPECT_EQ(a[i].time, b[i].time);
    EXPECT_EQ(a[i].color, b[i].color);
  }
}

TEST(PackedMotion, ARigHasTheFramesThatItWasPackedWith) {
  const Rig disk;
  const std::filesystem::path file = disk.folder / "rig.sbscene";
  SceneOptions options = options_of(disk.folder);
  options.frames = 3;
  const std::vector<std::string> notes = pack_scene(options, file);
  ASSERT_EQ(notes.size(), 1u);
  expect_contains(notes[0], "the first 3 of 5 frames");
  const Scene folder = read_scene(options);
  ASSERT_EQ(folder.train.size(), 6u);
  expect_same_times(folder.train, read_packed(options, file).train);
  options.frames.reset();
  expect_same_times(folder.test, read_packed(options, file).test);
  options.frames = 0;
  const std::string message = input_error_of([&] { read_packed(options, file); });
  expect_contains(message, "was packed with --frames 3, but --frames is 0; pack the scene again");
}

TEST(PackedMotion, ACaptureHasItsTimesAndItsFolder) {
  const Capture disk;
  const std::filesystem::path file = disk.folder / "capture.sbscene";
  std::filesystem::rename(disk.folder / "rgb/2x", disk.folder / "rgb/1x");
  SceneOptions options = options_of(disk.folder);
  pack_scene(options, file);
  const Scene folder = read_scene(options);
  expect_same_times(folder.train, read_packed(options, file).train);
  options.images = "rgb/1x";  // the default folder of the images
  expect_same_times(folder.test, read_packed(options, file).test);
  options.images = "images";
  expect_contains(input_error_of([&] { read_packed(options, file); }), "'rgb/1x', but --images is 'images'");
}

// The format found first is used.

// FastGS issue 45, "fast-d3dgs branch still treats the scene as static": a COLMAP model of the first frames, which its
// scripts write beside Neu3D's videos, was read instead of the videos.
TEST(DynamicScenes, StillTreatsTheSceneAsStatic) {
  const Rig disk;
  write_still_model(disk.folder.path());
  expect_rig(read_scene(options_of(disk.folder)), 0);
}

TEST(DynamicScenes, ACaptureIsNotTakenForAStillModelBesideIt) {
  const Capture disk;
  write_still_model(disk.folder.path());
  EXPECT_EQ(read_scene(disk.options()).train.size(), 6u);
}

TEST(DynamicScenes, BlendersFramesWithTimesAreNotTakenForAStillModelBesideThem) {
  const TemporaryFolder folder;
  write_still_model(folder.path());
  Json json{{"camera_angle_x", 0.8}, {"frames", Json::array()}};
  for (int i = 0; i < 3; ++i) {
    json["frames"].push_back({{"file_path", "r_" + std::to_string(i)},
                              {"time", 0.5 * i},
                              {"transform_matrix", {{1, 0, 0, i}, {0, 1, 0, 0}, {0, 0, 1, 4}, {0, 0, 0, 1}}}});
    write_grey(folder / ("r_" + std::to_string(i) + ".png"), 9);
  }
  write_file(folder / "transforms_train.json", json.dump());
  SceneOptions options = options_of(folder);
  options.eval = false;
  const Scene moving = read_scene(options);
  EXPECT_EQ(moving.train.size(), 3u);
  EXPECT_TRUE(moving.synthetic);
  std::filesystem::rename(folder / "transforms_train.json", folder / "transforms.json");
  const Scene frames = read_scene(options);
  ASSERT_EQ(frames.train.size(), 3u) << "nerfstudio's too";
  EXPECT_EQ(frames.train[1].time, 0.5f);
  EXPECT_FALSE(frames.synthetic);
  for (Json& frame : json["frames"]) frame.erase("time");
  for (const char* name : {"transforms_train.json", "transforms.json"}) write_file(folder / name, json.dump());
  EXPECT_EQ(read_scene(options).train.size(), 1u) << "without times COLMAP's goes first, as it always did";
}

TEST(DynamicScenes, AStillSceneWithPosesBoundsStaysOne) {
  const TemporaryFolder folder;
  write_still_model(folder.path());
  write_file(folder / "poses_bounds.npy", npy_bytes<double>("<f8", "(1, 17)", std::vector<double>(17)));
  SceneOptions options = options_of(folder);
  options.eval = false;
  EXPECT_EQ(read_scene(options).train[0].name, "still.png");
}

TEST(FrameTimes, AreTheLastNumbersOfNames) {
  std::vector<Photo> photos(3);
  photos[0].name = "cam2/take1_0007.png";
  photos[1].name = "9.jpg";
  photos[2].name = "cam11/15";
  EXPECT_EQ(set_frame_times(photos, "here"), "the names of 3 images have 3 different frame numbers, 7 to 15");
  EXPECT_EQ(photos[0].time, 0);
  EXPECT_EQ(photos[1].time, 0.25);
  EXPECT_EQ(photos[2].time, 1);
  photos[1].name = "cam3/left.png";
  expect_contains(input_error_of([&] { set_frame_times(photos, "here"); }), "here: the name of image 'cam3/left.png'");
  for (Photo& photo : photos) photo.name = "r_003.png";
  expect_contains(input_error_of([&] { set_frame_times(photos, "here"); }), "all images have frame number 3");
}

/// Two cameras with one picture each in frames 10 and 11.
void write_frames_of_colmap(const std::filesystem::path& folder) {
  ColmapModel model;
  model.cameras.push_back({1, 1, kWidth, kHeight, {30, 30, 20, 12}});
  for (int i = 0; i < 4; ++i) {
    ColmapImage image;
    image.id = static_cast<std::uint32_t>(i + 1);
    image.camera_id = 1;
    image.translation[0] = i;
    image.name = "cam" + std::to_string(i % 2) + "/frame_" + std::to_string(10 + i / 2) + ".png";
    write_grey(folder / ("images/" + image.name), 9);
    model.images.push_back(image);
  }
  model.points.positions = {0, 0, 3};
  model.points.colors = {9, 9, 9};
  std::filesystem::create_directories(folder / "sparse/0");
  write_colmap_model(folder / "sparse/0", model);
}

TEST(FrameTimes, AreOfColmapScenesWhereAskedFor) {
  const TemporaryFolder folder;
  write_frames_of_colmap(folder.path());
  SceneOptions options = options_of(folder);
  options.eval = false;
  for (const View& view : read_scene(options).train) EXPECT_EQ(view.time, 0);
  options.frame_times = true;
  const Scene scene = read_scene(options);
  ASSERT_EQ(scene.train.size(), 4u);
  EXPECT_EQ(scene.notes.at(0), "the names of 4 images have 2 different frame numbers, 10 to 11");
  for (const View& view : scene.train) {
    EXPECT_EQ(view.time, view.name.find("_11") != std::string::npos ? 1 : 0) << "not the camera's number";
  }
}

TEST(PackedMotion, NumbersOfFramesAreTakenWhenAColmapSceneIsPacked) {
  const TemporaryFolder folder;
  write_frames_of_colmap(folder.path());
  SceneOptions options = options_of(folder);
  options.eval = false;
  pack_scene(options, folder / "still.sbscene");
  options.frame_times = true;
  pack_scene(options, folder / "moving.sbscene");
  expect_same_times(read_scene(options).train, read_packed(options, folder / "moving.sbscene").train);
  expect_contains(input_error_of([&] { read_packed(options, folder / "still.sbscene"); }),
                  "its images were packed without times; pack the scene again with --frame-times");
  options.frame_times = false;
  EXPECT_EQ(read_packed(options, folder / "moving.sbscene").train.back().time, 1) << "what was packed is what there is";
}

TEST(DynamicScenes, DNerfReadsWithItsTimes) {
  const std::filesystem::path data = shared_data("dnerf_lego");
  if (data.empty()) GTEST_SKIP() << "no such data here";
  SceneOptions options;
  options.source = data;
  options.eval = true;
  options.random_points = 1000;
  const Scene scene = read_scene(options);
  EXPECT_EQ(scene.train.size(), 50u);
  EXPECT_EQ(scene.test.size(), 20u);
  EXPECT_EQ(scene.train.front().time, 0);
  EXPECT_EQ(scene.train.back().time, 1);
  EXPECT_FALSE(scene.white_background);
  EXPECT_TRUE(scene.synthetic);
  EXPECT_EQ(scene.points.size(), 1000u);
  for (const float at : scene.points.positions) EXPECT_LE(std::abs(at), 1.3f);
}

/// Without a time, test views would be compared with the model at time 0.
TEST(Blender, BothSplitsHaveTimesOrNeither) {
  for (const bool timed_train : {true, false}) {
    const TemporaryFolder folder;
    for (const std::string split : {"train", "test"}) {
      Json frames = Json::array();
      for (int i = 0; i < 3; ++i) {
        const std::string name = split + std::to_string(i);
        write_grey(folder / (name + ".png"), 90);
        Json pose = Json::array({{1, 0, 0, i}, {0, 1, 0, 0}, {0, 0, 1, 4}, {0, 0, 0, 1}});
        frames.push_back({{"file_path", "./" + name}, {"transform_matrix", pose}});
        if ((split == "train") == timed_train) frames.back()["time"] = 0.5 * i;
      }
      write_file(folder / ("transforms_" + split + ".json"), Json{{"camera_angle_x", 0.7}, {"frames", frames}}.dump());
    }
    const std::string error = input_error_of([&] { read_scene(options_of(folder)); });
    expect_contains(error, timed_train
                               ? "transforms_test.json: the frames have no 'time', but those of transforms_train"
                               : "transforms_train.json: the frames have no 'time', but those of transforms_test");
  }
}

TEST(ReadScene, ASequenceIsNoDataset) {
  const TemporaryFolder folder;
  write_file(folder / "traj.txt", "");
  expect_contains(input_error_of([&] { read_scene(options_of(folder)); }), "use splatboost slam");
}

TEST(InitialPoints, OneMustLieInATrainingView) {
  Scene scene;
  View view;
  view.camera.width = view.camera.height = 10;
  view.camera.fx = view.camera.fy = 10;
  view.camera.cx = view.camera.cy = 5;
  view.camera.camera_from_world = glm::mat4(1.0f);
  scene.train.push_back(view);
  scene.points.positions = {0, 0, -1, 6, 0, 10, 0, -6, 10};  // behind, right of and above the view
  expect_contains(input_error_of([&] { require_visible_points(scene); }), "none of the 3 initial points");
  scene.points.positions[3] = 4;
  require_visible_points(scene);
  for (float& coordinate : scene.points.positions) coordinate *= 0.015f;
  expect_contains(input_error_of([&] { require_visible_points(scene); }), "near plane");
}

TEST(CameraExtent, IsZeroAtOnePlaceWhateverTheRounding) {
  std::vector<View> views(40);
  for (std::size_t i = 0; i < views.size(); ++i) {
    const glm::mat4 turned = glm::rotate(glm::mat4(1.0f), 0.15f * static_cast<float>(i), glm::vec3(0.2f, 1, 0.1f));
    views[i].camera.camera_from_world = glm::translate(turned, glm::vec3(-100, -50, -20));
  }
  EXPECT_EQ(camera_extent(views), 0);
  views[0].camera.camera_from_world = glm::translate(views[0].camera.camera_from_world, glm::vec3(0.01f, 0, 0));
  EXPECT_NEAR(camera_extent(views), 1.1f * 0.01f, 5e-4f);
}

}  // namespace
}  // namespace splatboost::test
