// SPDX-License-Identifier: Apache-2.0
// Sequences on disk: their layout, and errors in them.
#include "trainer/sequence/sequence.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <span>

#include "support/temporary_folder.h"
#include "trainer/dataset/view_image.h"
#include "trainer/images/image_codec.h"
#include "trainer/images/video.h"
#include "trainer/support/input_error.h"

namespace splatboost::test {
namespace {

namespace fs = std::filesystem;

constexpr int kWidth = 48, kHeight = 40;

void write_color(const fs::path& file, std::uint8_t value) {
  const std::vector<std::uint8_t> pixels(3 * kWidth * kHeight, value);
  write_png(file, kWidth, kHeight, 3, std::span<const std::uint8_t>(pixels));
}
void write_depth(const fs::path& file, std::uint16_t value) {
  const std::vector<std::uint16_t> pixels(kWidth * kHeight, value);
  write_png(file, kWidth, kHeight, 1, std::span<const std::uint16_t>(pixels));
}
std::string calibration(const std::string& more = "") {
  return R"({"camera": {"w": 48, "h": 40, "fx": 50, "fy": 50, "cx": 23.5, "cy": 19.5, "scale": 1000)" + more + "}}";
}

/// Three frames in Replica's layout.
void make_replica(const fs::path& folder) {
  fs::create_directories(folder / "results");
  std::ofstream truth(folder / "traj.txt");
  for (int i = 0; i < 3; ++i) {
    write_color(folder / "results" / ("frame00000" + std::to_string(i) + ".png"), static_cast<std::uint8_t>(10 * i));
    write_depth(folder / "results" / ("depth00000" + std::to_string(i) + ".png"), static_cast<std::uint16_t>(2000 + i));
    truth << "1 0 0 " << i << " 0 1 0 0 0 0 1 0 0 0 0 1\n";
  }
  std::ofstream(folder / "cam_params.json") << calibration();
}

SequenceOptions of(const fs::path& source) {
  SequenceOptions options;
  options.source = source;
  return options;
}

std::string error_of(const std::function<void()>& what) {
  try {
    what();
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

void expect_in(const std::string& text, const std::string& part) {
  EXPECT_NE(text.find(part), std::string::npos) << text;
}

TEST(Sequence, replica_is_read) {
  const TemporaryFolder folder;
  make_replica(folder.path());
  const auto sequence = open_sequence(of(folder.path()));
  ASSERT_EQ(sequence->size(), 3u);
  const SequenceFrame frame = sequence->read(2);
  EXPECT_EQ(frame.problem, "");
  EXPECT_EQ(frame.color[0], 20);
  EXPECT_NEAR(frame.depth[7], 2.002f, 1e-6);
  ASSERT_TRUE(sequence->truth(2).has_value());
  EXPECT_EQ((*sequence->truth(2))[3].x, 2);
}

TEST(Sequence, saturated_depth_is_none) {
  const TemporaryFolder folder;
  make_replica(folder.path());
  std::vector<std::uint16_t> depth(kWidth * kHeight, 65535);
  depth[7] = 2000;
  write_png(folder / "results/depth000001.png", kWidth, kHeight, 1, std::span<const std::uint16_t>(depth));
  const SequenceFrame frame = open_sequence(of(folder.path()))->read(1);
  EXPECT_NEAR(frame.depth[7], 2, 1e-6);
  EXPECT_EQ(frame.depth[8], 0);
  write_depth(folder / "results/depth000001.png", 65535);
  expect_in(open_sequence(of(folder.path()))->read(1).problem, "depth000001.png: contains no depth values");
}

TEST(Sequence, names_that_results_cannot_hold_are_refused) {
  const TemporaryFolder folder;
  fs::create_directories(folder / "images");
  write_color(folder / "images" / "B\xfcro1.png", 10);
  std::ofstream(folder / "calibration.json") << calibration();
  expect_in(error_of([&] { open_sequence(of(folder.path())); }), "is not UTF-8; rename the image file");
}

TEST(Sequence, the_calibration_of_replica_may_be_above_the_folder) {
  const TemporaryFolder folder;
  make_replica(folder / "room0");
  fs::rename(folder / "room0/cam_params.json", folder / "cam_params.json");
  const fs::path before = fs::current_path();
  fs::current_path(folder / "room0");
  for (const fs::path& source :
       {folder / "room0", folder / "room0/", folder / "room0/.", fs::path("."), fs::path("./")}) {
    EXPECT_EQ(error_of([&] { EXPECT_EQ(open_sequence(of(source))->calibration().width, kWidth); }), "") << source;
  }
  fs::current_path(before);
}

TEST(Sequence, frames_are_in_the_order_of_their_numbers) {
  const TemporaryFolder folder;
  fs::create_directories(folder / "images");
  fs::create_directories(folder / "depth");
  std::ofstream truth(folder / "traj.txt");
  for (int i = 0; i < 11; ++i) {
    const std::string name = std::to_string(i) + ".png";
    write_color(folder / "images" / name, static_cast<std::uint8_t>(10 * i));
    write_depth(folder / "depth" / name, static_cast<std::uint16_t>(2000 + i));
    truth << "1 0 0 " << i << " 0 1 0 0 0 0 1 0 0 0 0 1\n";
  }
  truth.close();
  std::ofstream(folder / "calibration.json") << calibration();
  const auto sequence = open_sequence(of(folder.path()));
  ASSERT_EQ(sequence->size(), 11u);
  for (std::size_t i = 0; i < 11; ++i) {
    const SequenceFrame frame = sequence->read(i);
    EXPECT_EQ(frame.color[0], 10 * i);
    EXPECT_NEAR(frame.depth[7], 2 + 0.001 * static_cast<double>(i), 1e-6);
    EXPECT_EQ((*sequence->truth(i))[3].x, static_cast<double>(i));
  }
}

TEST(Sequence, frames_keep_their_poses_if_others_were_removed) {
  const TemporaryFolder folder;
  make_replica(folder.path());
  fs::remove(folder / "results/frame000001.png");
  const auto sequence = open_sequence(of(folder.path()));
  ASSERT_EQ(sequence->size(), 2u);
  ASSERT_TRUE(sequence->truth(1).has_value());
  EXPECT_EQ((*sequence->truth(1))[3].x, 2);
  ASSERT_EQ(sequence->notes().size(), 1u);
  expect_in(sequence->notes()[0], "contains 3 poses for 2 frames; a frame gets the pose of the number in its name");
  // Names without a number have no pose.
  fs::rename(folder / "results/frame000002.png", folder / "results/frame_last.png");
  EXPECT_FALSE(open_sequence(of(folder.path()))->truth(1).has_value());
}

TEST(Sequence, the_pose_of_a_frame_is_that_of_the_last_number_in_its_name) {
  const TemporaryFolder folder;
  fs::create_directories(folder / "images");
  for (const char* name : {"cam1_frame000002.png", "im-0.png"}) write_color(folder / "images" / name, 10);
  std::ofstream(folder / "calibration.json") << calibration();
  std::ofstream truth(folder / "traj.txt");
  for (int i = 0; i < 3; ++i) truth << "1 0 0 " << i << " 0 1 0 0 0 0 1 0 0 0 0 1\n";
  truth.close();
  auto sequence = open_sequence(of(folder.path()));
  ASSERT_TRUE(sequence->truth(0).has_value() && sequence->truth(1).has_value());
  EXPECT_EQ((*sequence->truth(0))[3].x, 2);
  EXPECT_EQ((*sequence->truth(1))[3].x, 0);
  EXPECT_EQ(sequence->notes()[0].find("but no name"), std::string::npos);

  fs::rename(folder / "images/cam1_frame000002.png", folder / "images/cam1_frame000700.png");
  fs::rename(folder / "images/im-0.png", folder / "images/im-99999999999999999999999.png");
  sequence = open_sequence(of(folder.path()));
  EXPECT_FALSE(sequence->truth(0).has_value() || sequence->truth(1).has_value());
  ASSERT_EQ(sequence->notes().size(), 1u);
  expect_in(sequence->notes()[0], "contains 3 poses for 2 frames");
  expect_in(sequence->notes()[0], "but no name has the number of a pose");
}

TEST(Sequence, lines_that_are_no_poses_are_refused) {
  const TemporaryFolder folder;
  make_replica(folder.path());
  const auto with = [&](const std::string& text) {
    std::ofstream(folder / "traj.txt") << text;
    return error_of([&] { open_sequence(of(folder.path())); });
  };
  const std::string pose = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";
  expect_in(with("\n" + pose + "\n1 0 0\n"), "traj.txt:3: expected 16 numbers");
  expect_in(with("0.033 " + pose + "\n"), "traj.txt:1: expected 16 numbers");
  expect_in(with(pose + "\n0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0\n"), "traj.txt:2: the matrix is not a rigid transform");
  EXPECT_EQ(with(pose + " \r\n"), "");
}

TEST(Sequence, depth_that_belongs_to_no_image_is_refused) {
  const TemporaryFolder folder;
  make_replica(folder.path());
  for (int i = 0; i < 3; ++i) {
    const std::string number = std::to_string(i) + ".png";
    fs::rename(folder / "results" / ("depth00000" + number), folder / "results" / ("depth_" + number));
  }
  SequenceOptions options = of(folder.path());
  expect_in(error_of([&] { open_sequence(options); }),
            "results: has 3 depth images, none of them named like a picture: the first depth image is depth_0.png, the "
            "first picture frame000000.png");
  // A calibration without depth_scale says that depth is not wanted.
  options.calibration = folder / "camera.json";
  std::ofstream(options.calibration) << R"({"w": 48, "h": 40, "fx": 50, "fy": 50, "cx": 23.5, "cy": 19.5})";
  EXPECT_EQ(open_sequence(options)->read(0).problem, "");

  const fs::path plain = folder / "plain";
  fs::create_directories(plain / "images");
  fs::create_directories(plain / "depth");
  for (int i = 0; i < 10; ++i) {
    write_color(plain / "images" / (std::to_string(i) + ".png"), 10);
    write_depth(plain / "depth" / ("x" + std::to_string(i) + ".png"), 2000);
  }
  std::ofstream(plain / "calibration.json") << calibration();
  expect_in(error_of([&] { open_sequence(of(plain)); }),
            "depth: has 10 depth images, none of them named like a picture");
  // One that fits is enough: the others may have been removed.
  fs::rename(plain / "depth/x3.png", plain / "depth/3.png");
  EXPECT_FALSE(open_sequence(of(plain))->read(3).depth.empty());

  const fs::path tum = folder / "freiburg3";
  fs::create_directories(tum);
  std::ofstream(tum / "rgb.txt") << "1.0 rgb/a.png\n2.0 rgb/b.png\n";
  std::ofstream(tum / "depth.txt") << "1.5 depth/a.png\n";
  expect_in(error_of([&] { open_sequence(of(tum)); }), "no depth image belongs to a picture of rgb.txt");
}

TEST(Sequence, an_unknown_key_of_a_calibration_is_refused) {
  const TemporaryFolder folder;
  const fs::path file = folder / "camera.json";
  const auto with = [&](const std::string& text) {
    std::ofstream(file) << text;
    return error_of([&] { read_calibration(file); });
  };
  EXPECT_EQ(with(calibration(R"(, "k1": 0.1, "k2": 0, "p1": 0, "p2": 0, "k3": 0, "k4": 0)")), "");
  expect_in(
      with(calibration(", \"foo\": 3")),
      "camera.json: unknown key 'foo'; known: width, height, fx, fy, cx, cy, k1, k2, p1, p2, k3, depth_scale, w, h, "
      "scale");
  const std::string all = calibration();
  expect_in(with(all.substr(0, all.size() - 1) + ", \"depth_scale\": 1000}"),
            "beside 'camera': unknown key 'depth_scale'");
  expect_in(with(calibration(", \"depth_scale\": 5000")),
            "'depth_scale' and 'scale' mean the same, but have different");
  expect_in(with(calibration(", \"width\": 64")), "'width' and 'w' mean the same, but have different values");
  EXPECT_EQ(with(calibration(", \"depth_scale\": 1000")), "");
}

/// The file of the Replica sequences that came with NICE-SLAM.
TEST(Sequence, the_published_calibration_of_replica_is_accepted) {
  const TemporaryFolder folder;
  std::ofstream(folder / "cam_params.json") << R"({"camera": {"w": 1200, "h": 680, "fx": 600.0, "fy": 600.0,
    "cx": 599.5, "cy": 339.5, "scale": 6553.5}})";
  const Calibration c = read_calibration(folder / "cam_params.json");
  EXPECT_EQ(c.width, 1200);
  EXPECT_EQ(c.depth_scale, 6553.5);
}

TEST(Sequence, hidden_files_are_no_images) {
  const TemporaryFolder folder;
  fs::create_directories(folder / "images");
  write_color(folder / "images/a.png", 10);
  std::ofstream(folder / "images/._a.png") << "attributes of macOS";
  std::ofstream(folder / "calibration.json") << calibration();
  fs::create_directories(folder / "results");  // of something else; Replica's has frame*.jpg
  const auto sequence = open_sequence(of(folder.path()));
  ASSERT_EQ(sequence->size(), 1u);
  EXPECT_EQ(sequence->read(0).color[0], 10);
}

TEST(Sequence, some_frames_are_chosen) {
  const TemporaryFolder folder;
  make_replica(folder.path());
  SequenceOptions options = of(folder.path());
  options.stride = 2;
  EXPECT_EQ(open_sequence(options)->size(), 2u);
  options.first = 1;
  const auto sequence = open_sequence(options);
  ASSERT_EQ(sequence->size(), 1u);
  EXPECT_EQ(sequence->read(0).color[0], 10);
  options.first = 3;
  expect_in(error_of([&] { open_sequence(options); }), "has 3 frames");
  for (const char* name : {"frame000001.png", "frame000002.png"}) fs::remove(folder / "results" / name);
  expect_in(error_of([&] { open_sequence(options); }), "has 1 frame, none");
}

TEST(Sequence, a_frame_that_cannot_be_read_says_why_and_the_others_stay) {
  const TemporaryFolder folder;
  make_replica(folder.path());
  std::ofstream(folder / "results/frame000001.png") << "no picture";
  fs::remove(folder / "results/depth000002.png");
  write_depth(folder / "results/depth000000.png", 0);
  const auto sequence = open_sequence(of(folder.path()));
  const SequenceFrame empty = sequence->read(0), broken = sequence->read(1), flat = sequence->read(2);
  expect_in(empty.problem, "no depth values");
  EXPECT_TRUE(empty.depth.empty());
  EXPECT_FALSE(empty.color.empty());
  EXPECT_TRUE(broken.color.empty());
  expect_in(broken.problem, "frame000001.png");
  EXPECT_TRUE(flat.depth.empty());
  EXPECT_FALSE(flat.color.empty());
  ASSERT_EQ(sequence->notes().size(), 1u);
  expect_in(sequence->notes()[0], "1 of 3 frames has no depth");
}

TEST(Sequence, a_folder_with_the_name_of_a_picture_is_none) {
  const TemporaryFolder folder;
  make_replica(folder.path());
  fs::remove(folder / "results/frame000001.png");
  fs::create_directory(folder / "results/frame000001.png");
  expect_in(open_sequence(of(folder.path()))->read(1).problem, "frame000001.png: is not a file");
}

TEST(Sequence, tum_pairs_by_time) {
  const TemporaryFolder parent;
  const fs::path folder = parent / "rgbd_dataset_freiburg3_toy";
  fs::create_directories(folder / "rgb");
  std::ofstream(folder / "rgb.txt") << "# color\n \n1.000 rgb/a.png\n1.033 rgb/b.png\r\n \t\r\n";
  std::ofstream(folder / "depth.txt") << "1.031 depth/b.png\n";
  std::ofstream(folder / "groundtruth.txt") << " # truth\n1.001 1 2 3 0 0 0 1\n \n";
  const auto sequence = open_sequence(of(folder));
  ASSERT_EQ(sequence->size(), 2u);
  EXPECT_EQ(sequence->calibration().depth_scale, 5000);
  EXPECT_NEAR(sequence->time_of(1), 1.033, 1e-12);
  ASSERT_TRUE(sequence->truth(0).has_value());
  EXPECT_EQ((*sequence->truth(0))[3].z, 3);
  EXPECT_FALSE(sequence->truth(1).has_value());
  std::ofstream(folder / "groundtruth.txt") << "501.0 1 2 3 0 0 0 1\n";
  expect_in(open_sequence(of(folder))->notes()[0], "groundtruth.txt: no pose within 20 ms of a picture");
}

TEST(Sequence, tum_pictures_are_known_by_time_and_folder) {
  const TemporaryFolder parent;
  const fs::path folder = parent / "fr1";
  fs::create_directories(folder);
  std::ofstream(folder / "rgb.txt") << "1.0 a/0.png\n2.0 b/0.png\n1.0 a/0.png\n";
  const auto sequence = open_sequence(of(folder));
  EXPECT_EQ(sequence->name_of(0), "a/0.png");
  EXPECT_EQ(sequence->name_of(2), "b/0.png");
  EXPECT_EQ(sequence->read(2).name, "b/0.png");
  std::ofstream(folder / "rgb.txt") << "\xEF\xBB\xBF"
                                    << "1.0 rgb/a.png\n";
  EXPECT_EQ(open_sequence(of(folder))->name_of(0), "rgb/a.png");
  std::ofstream(folder / "rgb.txt") << "# pictures\n1.0,rgb/a.png\n2.0, rgb/b.png\n";
  expect_in(error_of([&] { open_sequence(of(folder)); }), "rgb.txt:2: expected 'time path', separated by a space");
  std::ofstream(folder / "rgb.txt") << "1.0 rgb/a.png\n1.0 rgb/b.png\n";
  expect_in(error_of([&] { open_sequence(of(folder)); }), "rgb.txt: rgb/a.png and rgb/b.png have the same time");
}

TEST(Sequence, tum_poses_may_be_in_any_order) {
  const TemporaryFolder parent;
  const fs::path folder = parent / "rgbd_dataset_freiburg2_toy";
  fs::create_directories(folder);
  std::ofstream(folder / "rgb.txt") << "1.000 rgb/a.png\n2.000 rgb/b.png\n";
  std::ofstream(folder / "groundtruth.txt") << "2.000 4 5 6 0 0 0 1\n1.000 1 2 3 0 0 0 1\n";
  const auto sequence = open_sequence(of(folder));
  ASSERT_TRUE(sequence->truth(0).has_value() && sequence->truth(1).has_value());
  EXPECT_EQ((*sequence->truth(0))[3].z, 3);
  EXPECT_EQ((*sequence->truth(1))[3].z, 6);
}

TEST(Sequence, tum_cameras_are_named_by_the_folder_or_the_one_that_contains_it) {
  const TemporaryFolder parent;
  const auto camera = [&](const fs::path& folder) {
    fs::create_directories(folder);
    std::ofstream(folder / "rgb.txt") << "1.000 rgb/a.png\n";
    const std::string note = open_sequence(of(folder))->notes().at(0);
    return note.substr(note.find("camera "), 16);
  };
  EXPECT_EQ(camera(parent / "fr1/rgbd_dataset_freiburg3_toy"), "camera freiburg3");
  EXPECT_EQ(open_sequence(of(parent / "fr1/rgbd_dataset_freiburg3_toy"))->calibration().fx, 535.4);
  EXPECT_EQ(camera(parent / "fr2/desk/."), "camera freiburg2") << "the folder that contains it";
  EXPECT_EQ(camera(parent / "fr2/desk/"), "camera freiburg2");
  EXPECT_EQ(camera(parent / "FR1_desk2"), "camera freiburg1");
  EXPECT_EQ(camera(parent / "rgbd_dataset_freiburg1_xyz-2hz"), "camera freiburg1");
  for (const char* other : {"fr3d", "home_fr1tz", "freiburg12", "fr1/my/room"}) {
    expect_in(error_of([&] { camera(parent / other); }), "the camera is unknown");
  }
}

/// The decoder would fill the missing part with grey.
TEST(Sequence, a_jpeg_that_is_cut_short_is_no_image) {
  const TemporaryFolder folder;
  make_replica(folder.path());
  // An end marker before the scan is that of a thumbnail.
  const std::string begin("\xff\xd8\xff\xe1\x00\x04\xff\xd9\xff\xda\x00\x02\x11\xff\x00\x22", 16);
  std::ofstream(folder / "results/frame000000.png") << begin;
  std::ofstream(folder / "results/frame000001.png") << begin << "\xff\xd9";
  std::ofstream(folder / "results/frame000002.png").close();
  const auto sequence = open_sequence(of(folder.path()));
  const SequenceFrame cut = sequence->read(0);
  EXPECT_TRUE(cut.color.empty());
  expect_in(cut.problem, "frame000000.png: the JPEG is cut short");
  EXPECT_EQ(sequence->read(1).problem.find("cut short"), std::string::npos) << sequence->read(1).problem;
  expect_in(sequence->read(2).problem, "frame000002.png: the image is empty");
}

/// k1 bends straight lines; pixels without data are invalid.
TEST(Sequence, distortion_is_taken_out) {
  if (!have_opencv()) GTEST_SKIP() << "only OpenCV takes distortion out";
  const TemporaryFolder folder;
  make_replica(folder.path());
  std::vector<std::uint8_t> pixels(3 * kWidth * kHeight, 0);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x)
      pixels[static_cast<std::size_t>(3 * (y * kWidth + x))] = static_cast<std::uint8_t>(5 * x);
  }
  write_png(folder / "results/frame000000.png", kWidth, kHeight, 3, std::span<const std::uint8_t>(pixels));
  std::ofstream(folder / "cam_params.json") << calibration(", \"k1\": 0.5");
  const SequenceFrame frame = open_sequence(of(folder.path()))->read(0);
  // A pixel at 0.2 of the focal length from the principal point: its data lie at about 0.2·(1 + 0.5·0.04) = 0.204.
  const double x = (33 - 23.5) / 50, y = (20 - 19.5) / 50;
  const double expected = 5 * (23.5 + 50 * x * (1 + 0.5 * (x * x + y * y)));
  EXPECT_NEAR(frame.color[3 * (20 * kWidth + 33)], expected, 1.01);
  EXPECT_EQ(frame.valid[20 * kWidth + 33], 255);
  EXPECT_EQ(frame.valid[0], 0);
}

TEST(Sequence, where_distortion_folds_the_image_there_is_no_data) {
  if (!have_opencv()) GTEST_SKIP() << "only OpenCV takes distortion out";
  const TemporaryFolder folder;
  make_replica(folder.path());
  // The distorted radius r · (1 − 1.2 r²) increases up to 1 / sqrt(3.6) and then decreases; corners are at 0.61.
  std::ofstream(folder / "cam_params.json") << calibration(", \"k1\": -1.2");
  const double fold = 1 / std::sqrt(3.6);
  const SequenceFrame frame = open_sequence(of(folder.path()))->read(0);
  ASSERT_EQ(frame.valid.size(), static_cast<std::size_t>(kWidth * kHeight));
  std::size_t beyond = 0;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const double radius = std::hypot((x - 23.5) / 50, (y - 19.5) / 50);
      if (std::abs(radius - fold) < 0.001) continue;
      const bool folded = radius > fold;
      beyond += folded ? 1 : 0;
      EXPECT_EQ(frame.valid[static_cast<std::size_t>(y * kWidth + x)], folded ? 0 : 255) << x << ", " << y;
    }
  }
  EXPECT_GT(beyond, 20u);
}

/// Five frames of different grey levels at 10 frames per second.
void make_video(const fs::path& file) {
  VideoFile video(file, kWidth, kHeight, 10);
  for (int frame = 0; frame < 5; ++frame) {
    video.add(std::vector<float>(3 * kWidth * kHeight, static_cast<float>(40 + 40 * frame) / 255));
  }
  video.finish();
}

TEST(Sequence, a_video_is_read) {
  if (!have_opencv()) GTEST_SKIP() << "only OpenCV reads videos";
  const TemporaryFolder folder;
  make_video(folder / "walk.TS.mp4");
  std::ofstream(folder / "camera.json") << calibration();
  SequenceOptions options = of(folder / "walk.TS.mp4");
  options.calibration = folder / "camera.json";
  const auto sequence = open_sequence(options);
  ASSERT_EQ(sequence->size(), 5u);
  EXPECT_FALSE(sequence->calibration().has_depth());
  for (const std::size_t number : {0u, 3u, 4u, 1u, 2u}) {  // backwards too
    const SequenceFrame frame = sequence->read(number);
    EXPECT_EQ(frame.problem, "");
    EXPECT_NEAR(frame.color[0], 40 + 40 * static_cast<int>(number), 4) << number;
    EXPECT_NEAR(frame.time, 0.1 * static_cast<double>(number), 1e-6);
    EXPECT_EQ(frame.name, "walk.TS_00000" + std::to_string(number) + ".png");
    EXPECT_TRUE(frame.depth.empty());
  }
  options.first = 1;
  options.stride = 2;
  options.count = 1;
  const auto some = open_sequence(options);
  ASSERT_EQ(some->size(), 1u);
  EXPECT_NEAR(some->read(0).color[0], 80, 4);
}

TEST(Sequence, what_is_wrong_with_a_video_is_one_line) {
  if (!have_opencv()) GTEST_SKIP() << "only OpenCV reads videos";
  const TemporaryFolder folder;
  make_video(folder / "walk.mp4");
  std::ofstream(folder / "notes.mp4") << "no video";
  std::ofstream(folder / "camera.json") << R"({"w": 64, "h": 40, "fx": 50, "fy": 50, "cx": 24, "cy": 20})";
  expect_in(error_of([&] { open_sequence(of(folder / "notes.mp4")); }), "notes.mp4: OpenCV cannot read the video");
  SequenceOptions options = of(folder / "walk.mp4");
  expect_in(error_of([&] { open_sequence(options); }), "give a file with --calibration");
  options.calibration = folder / "camera.json";
  expect_in(error_of([&] { open_sequence(options); }), "walk.mp4: has 48x40 pixels, but ");
  std::ofstream(folder / "camera.json") << calibration();
  options.first = 5;
  expect_in(error_of([&] { open_sequence(options); }), "has 5 frames, none of them from frame 5 onwards");
}

TEST(Sequence, what_is_wrong_is_one_line) {
  const TemporaryFolder folder;
  make_replica(folder.path());
  const auto with = [&](const std::string& text) {
    std::ofstream(folder / "cam_params.json") << text;
    return error_of([&] { open_sequence(of(folder.path())); });
  };
  expect_in(with("{\"camera\": {\"w\": 48}}"), "has no 'height'");
  expect_in(with(R"({"w": 48, "h": 40, "fx": -1, "fy": 50, "cx": 24, "cy": 20})"), "focal lengths must be above 0");
  expect_in(with(R"({"w": 48, "h": 40, "fx": 0.5, "fy": 50, "cx": 24, "cy": 20})"), "do not match the image size");
  expect_in(with(R"({"w": 48, "h": 40, "fx": 50, "fy": 50, "cx": 240, "cy": 20})"), "principal point");
  expect_in(with(R"({"w": 32, "h": 24, "fx": 50, "fy": 50, "cx": 16, "cy": 12})"),
            "the image size 32x24 is out of range: width and height must be 32 to 16384 px");
  expect_in(with(calibration(", \"k1\": 1e6")),
            "the distortion k1, k2, p1, p2, k3 moves 100 % of a picture out of sight");
  expect_in(with(calibration(", \"k4\": 0.1")), "k4 is not supported");
  EXPECT_EQ(with(calibration(", \"k4\": 0")), "");
  EXPECT_EQ(with(R"({"w": 96, "h": 40, "fx": 50, "fy": 50, "cx": 24, "cy": 20})"), "");
  expect_in(open_sequence(of(folder.path()))->read(0).problem, "calibration has 96x40");
  fs::remove(folder / "cam_params.json");
  expect_in(error_of([&] { open_sequence(of(folder.path())); }), "no cam_params.json");
  expect_in(error_of([&] { open_sequence(of(folder / "nothing")); }), "no such file");
  fs::create_directories(folder / "empty");
  expect_in(error_of([&] { open_sequence(of(folder / "empty")); }), "is not a sequence");
  fs::create_directories(folder / "mav0/cam0");
  std::ofstream(folder / "mav0/cam0/data.csv") << "";
  expect_in(error_of([&] { open_sequence(of(folder / "mav0")); }),
            "mav0: is a part of an EuRoC sequence; name the folder that contains mav0");
  fs::create_directories(folder / "colmap/images");
  fs::create_directories(folder / "colmap/sparse/0");
  write_color(folder / "colmap/images/a.png", 1);
  expect_in(error_of([&] { open_sequence(of(folder / "colmap")); }), "is a COLMAP scene, whose cameras are known");
}

}  // namespace
}  // namespace splatboost::test
