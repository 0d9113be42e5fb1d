// SPDX-License-Identifier: Apache-2.0
// Stereo pairs in EuRoC's layout: depth against that of the ray-traced room, and errors in such folders.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <string>
#include <vector>

#include "splatboost/threads.h"
#include "support/temporary_folder.h"
#include "trainer/images/image_codec.h"
#include "trainer/sequence/sequence.h"
#include "trainer/support/input_error.h"
#include "trainer/synth/synth.h"
#include "trainer/synth/synth_view.h"

namespace splatboost::test {
namespace {

namespace fs = std::filesystem;

constexpr int kWidth = 200, kHeight = 150;

SynthOptions pairs(const fs::path& output, int frames) {
  SynthOptions options;
  options.output = output;
  options.scene = "walk";
  options.baseline = 0.1;
  options.width = kWidth;
  options.height = kHeight;
  options.views = frames;
  options.samples = 1;
  return options;
}

SequenceOptions of(const fs::path& source) {
  SequenceOptions options;
  options.source = source;
  return options;
}

void change(const fs::path& file, const std::function<void(std::string&)>& how) {
  std::ifstream in(file);
  std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  how(text);
  std::ofstream(file) << text;
}

void replace(std::string& text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  ASSERT_NE(at, std::string::npos) << from;
  text.replace(at, from.size(), to);
}

std::string error_of(const fs::path& source) {
  try {
    open_sequence(of(source));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

void expect_in(const std::string& text, const std::string& part) {
  EXPECT_NE(text.find(part), std::string::npos) << text;
}

class Stereo : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!have_opencv()) GTEST_SKIP() << "this build has no OpenCV";
    write_synthetic_scene(pairs(walk(), 2));
  }
  fs::path walk() const { return folder_.path() / "walk"; }

  TemporaryFolder folder_;
};

TEST_F(Stereo, depth_is_that_of_the_room) {
  const auto sequence = open_sequence(of(walk()));
  ASSERT_EQ(sequence->size(), 2u);
  EXPECT_NEAR(sequence->time_of(1) - sequence->time_of(0), 0.05, 1e-6);
  const Calibration& c = sequence->calibration();
  EXPECT_DOUBLE_EQ(c.fx, c.fy);
  synthetic::Intrinsics camera(kWidth, kHeight);
  camera.focal = c.fx;
  camera.cx = c.cx + 0.5;
  camera.cy = c.cy + 0.5;
  const auto world = synthetic::make_room();
  Threads threads;
  const SequenceFrame frame = sequence->read(1);
  ASSERT_EQ(frame.problem, "");
  ASSERT_TRUE(sequence->truth(1).has_value());
  const glm::dmat4 pose = *sequence->truth(1);
  synthetic::Picture truth(camera);
  synthetic::render_view(*world, camera, {glm::dvec3(pose[3]), glm::dmat3(pose)}, 1, threads, truth);
  std::vector<double> depth_errors, color_errors;
  for (std::size_t i = 0; i < truth.depth.size(); ++i) {
    color_errors.push_back(std::abs(static_cast<int>(frame.color[3 * i]) - static_cast<int>(truth.color[3 * i])));
    if (frame.depth[i] > 0) depth_errors.push_back(std::abs(frame.depth[i] / truth.depth[i] - 1));
  }
  EXPECT_GT(depth_errors.size(), truth.depth.size() / 3);
  const auto median = [](std::vector<double>& values) {
    std::ranges::sort(values);
    return values[values.size() / 2];
  };
  EXPECT_LT(median(depth_errors), 0.03);  // a tenth of a pixel of disparity is 0.02 at 3 m
  EXPECT_LT(median(color_errors), 4);
}

TEST_F(Stereo, a_missing_second_picture_leaves_a_frame_without_depth) {
  change(walk() / "mav0/cam1/data.csv", [](std::string& text) { text.resize(text.rfind('\n', text.size() - 2) + 1); });
  const auto sequence = open_sequence(of(walk()));
  ASSERT_EQ(sequence->notes().size(), 1u);
  expect_in(sequence->notes()[0], "1 of 2 frames has no second image");
  EXPECT_FALSE(sequence->read(0).depth.empty());
  const SequenceFrame frame = sequence->read(1);
  EXPECT_TRUE(frame.depth.empty());
  EXPECT_FALSE(frame.color.empty());
  expect_in(frame.problem, "has no second image");
}

TEST_F(Stereo, mistakes_are_told) {
  const fs::path sensor = walk() / "mav0/cam1/sensor.yaml";
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string before;
    change(sensor, [&](std::string& text) {
      before = text;
      replace(text, from, to);
    });
    const std::string error = error_of(walk());
    change(sensor, [&](std::string& text) { text = before; });
    return error;
  };
  expect_in(with("intrinsics:", "intrinsic:"), "cam1/sensor.yaml: has no 'intrinsics'");
  expect_in(with("intrinsics: [", "intrinsics:\n  - 458\nother: ["), "intrinsics: expected numbers in brackets");
  // A calibration that was commented out took the place of the other.
  EXPECT_EQ(with("intrinsics:", "# intrinsics: [1, 2, 3, 4]\nintrinsics:"), "");
  change(walk() / "mav0/cam0/data.csv", [](std::string& text) {
    text += text.substr(text.rfind('\n', text.size() - 2) + 1);
    text.replace(text.rfind(','), std::string::npos, ",another.png\n");
  });
  expect_in(error_of(walk()), "cam0/data.csv: ");
  expect_in(error_of(walk()), "have the same time; each picture needs its own");
  change(walk() / "mav0/cam0/data.csv", [](std::string& text) { text.resize(text.rfind('\n', text.size() - 2) + 1); });
  expect_in(with("resolution: [200,", "resolution: [wide,"), "'wide' is not a number");
  expect_in(with("resolution: [200,", "resolution: [100, 200,"), "expected 2 numbers");
  expect_in(with("[200, 150]", "[200, 152]"), "the two cameras have different image sizes");
  expect_in(with("data: [-0.", "data: [-7."), "T_BS is not a rigid transform");
  fs::copy_file(walk() / "mav0/cam0/sensor.yaml", sensor, fs::copy_options::overwrite_existing);
  expect_in(error_of(walk()), "cam1/sensor.yaml: the cameras of a stereo pair must be side by side");
}

TEST_F(Stereo, one_camera_alone_has_no_depth) {
  const auto stereo = open_sequence(of(walk()));
  fs::remove_all(walk() / "mav0/cam1");
  const auto sequence = open_sequence(of(walk()));
  ASSERT_EQ(sequence->size(), 2u);
  ASSERT_EQ(sequence->notes().size(), 1u);
  expect_in(sequence->notes()[0], "has no mav0/cam1; mav0/cam0 is tracked alone");
  EXPECT_FALSE(sequence->calibration().has_depth());
  EXPECT_NEAR(sequence->calibration().fx, synthetic::Intrinsics(kWidth, kHeight).focal, 1e-6);
  const SequenceFrame frame = sequence->read(1);
  EXPECT_EQ(frame.problem, "");
  EXPECT_FALSE(frame.color.empty());
  EXPECT_TRUE(frame.depth.empty());
  ASSERT_TRUE(sequence->truth(1).has_value());
  EXPECT_LT(glm::length((*sequence->truth(1))[3] - (*stereo->truth(1))[3]), 1e-9);

  // A calibration for one camera is usable here.
  SequenceOptions options = of(walk());
  options.calibration = folder_ / "camera.json";
  std::ofstream(options.calibration)
      << R"({"width": 200, "height": 150, "fx": 170, "fy": 171, "cx": 99, "cy": 74, "depth_scale": 1000})";
  const auto calibrated = open_sequence(options);
  EXPECT_EQ(calibrated->calibration().fy, 171);
  EXPECT_FALSE(calibrated->calibration().has_depth());
}

TEST_F(Stereo, poses_of_another_time_are_told) {
  const fs::path file = walk() / "mav0/state_groundtruth_estimate0/data.csv";
  EXPECT_TRUE(open_sequence(of(walk()))->notes().empty());
  std::ofstream(file) << "# poses\n1000000000,0,0,0,1,0,0,0\n";
  const auto sequence = open_sequence(of(walk()));
  ASSERT_EQ(sequence->notes().size(), 1u);
  expect_in(sequence->notes()[0], "data.csv: no pose within 20 ms of a picture");
}

TEST_F(Stereo, depth_depends_on_the_calibration) {
  EXPECT_TRUE(open_sequence(of(walk()))->computes_depth());
  fs::remove_all(walk() / "mav0/cam1");
  EXPECT_FALSE(open_sequence(of(walk()))->computes_depth());
}

TEST_F(Stereo, a_calibration_beside_its_own_is_refused) {
  SequenceOptions options = of(walk());
  options.calibration = "camera.json";
  EXPECT_THROW(open_sequence(options), InputError);
}

}  // namespace
}  // namespace splatboost::test
