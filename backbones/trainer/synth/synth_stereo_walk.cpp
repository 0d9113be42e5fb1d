// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <memory>
#include <span>
#include <string>

#include <glm/gtc/quaternion.hpp>

#include "splatboost/threads.h"
#include "trainer/dataset/view_image.h"
#include "trainer/support/atomic_file.h"
#include "trainer/synth/synth_view.h"
#include "trainer/synth/synth_walk.h"

namespace splatboost {
namespace {

using namespace synthetic;

constexpr long long kFirstTime = 1'400'000'000'000'000'000, kFrameTime = 50'000'000;  // ns: 20 frames per second

template <class... Values>
std::string printed(const char* format, Values... values) {
  char text[512];
  std::snprintf(text, sizeof(text), format, values...);
  return text;
}

/// Pose of the second camera in the frame of the first: beside it and, as in real rigs, not quite parallel to it.
Pose second_from_first(double baseline) {
  const glm::dquat turn = glm::angleAxis(0.008, glm::normalize(glm::dvec3(0.3, 1, 0.2)));
  return {{baseline, 0.01 * baseline, -0.02 * baseline}, glm::mat3_cast(turn)};
}

/// The body frame has x up, y left and z forward, approximately as in EuRoC.
const Mat3 kBodyFromCamera(Vec3(0, -1, 0), Vec3(-1, 0, 0), Vec3(0, 0, -1));

std::string sensor_yaml(const Intrinsics& camera, const Pose& in_first) {
  const Mat3 turn = kBodyFromCamera * in_first.world_from_camera;
  const Vec3 place = kBodyFromCamera * in_first.centre;
  std::string pose;
  for (int row = 0; row < 3; ++row) {
    pose += printed("%.12f, %.12f, %.12f, %.12f,\n         ", turn[0][row], turn[1][row], turn[2][row], place[row]);
  }
  return "sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [" + pose + "0.0, 0.0, 0.0, 1.0]\nrate_hz: 20\n" +
         printed("resolution: [%d, %d]\ncamera_model: pinhole\nintrinsics: [%.9f, %.9f, %.9f, %.9f]\n", camera.width,
                 camera.height, camera.focal, camera.focal, camera.cx - 0.5, camera.cy - 0.5) +
         "distortion_model: radial-tangential\ndistortion_coefficients: [0.0, 0.0, 0.0, 0.0]\n";
}

}  // namespace

void write_stereo_walk(const SynthOptions& options) {
  const std::filesystem::path mav = options.output / "mav0";
  const std::unique_ptr<const World> world = make_room();
  const Intrinsics camera(options.width, options.height);
  const Pose first{Vec3(0.0), Mat3(1.0)}, second = second_from_first(options.baseline);
  Threads threads;
  Picture picture(camera);
  std::string pictures = "#timestamp [ns],filename\n";
  std::string truth =
      "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n";
  for (const char* name : {"cam0", "cam1"}) make_folder(mav / name / "data");
  make_folder(mav / "state_groundtruth_estimate0");
  for (int i = 0; i < options.views; ++i) {
    const Pose left = walk_pose(i, options.views);
    const std::string time = std::to_string(kFirstTime + i * kFrameTime);
    for (const auto& [name, in_first] : {std::pair("cam0", first), std::pair("cam1", second)}) {
      const Pose pose{left.centre + left.world_from_camera * in_first.centre,
                      left.world_from_camera * in_first.world_from_camera};
      render_view(*world, camera, pose, options.samples, threads, picture);
      write_png(mav / name / "data" / (time + ".png"), camera.width, camera.height, 3,
                std::span<const std::uint8_t>(picture.color));
    }
    pictures += time + "," + time + ".png\n";
    const glm::dquat q = glm::quat_cast(left.world_from_camera * glm::transpose(kBodyFromCamera));
    truth += time + printed(",%.9f,%.9f,%.9f,%.12f,%.12f,%.12f,%.12f\n", left.centre.x, left.centre.y, left.centre.z,
                            q.w, q.x, q.y, q.z);
  }
  write_text_atomically(mav / "cam0" / "sensor.yaml", sensor_yaml(camera, first));
  write_text_atomically(mav / "cam1" / "sensor.yaml", sensor_yaml(camera, second));
  for (const char* name : {"cam0", "cam1"}) write_text_atomically(mav / name / "data.csv", pictures);
  write_text_atomically(mav / "state_groundtruth_estimate0" / "data.csv", truth);
}

}  // namespace splatboost
