// SPDX-License-Identifier: Apache-2.0
#include "trainer/synth/synth_walk.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "splatboost/random.h"
#include "splatboost/threads.h"
#include "trainer/dataset/view_image.h"
#include "trainer/support/atomic_file.h"
#include "trainer/synth/synth_view.h"

namespace splatboost {
namespace {

using namespace synthetic;

constexpr double kTurns = 1.12;                  // around the room: the end overlaps the beginning
constexpr double kDepthScale = 6553.5;           // as in Replica
constexpr double kFarthest = 8, kNearest = 0.3;  // metres
constexpr double kEdge = 0.04;                   // relative depth difference of neighbours at an edge
constexpr double kGrazing = 0.15;                // cosine to the normal below which there is no measurement

/// Depth that a sensor would measure, metres; 0: no measurement.
double measured(const Picture& picture, const Intrinsics& camera, const Pose& pose, int x, int y,
                const RandomStream& random) {
  const auto at = [&](int column, int row) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(camera.width) + static_cast<std::size_t>(column);
  };
  const std::size_t pixel = at(x, y);
  const double z = picture.depth[pixel];
  if (!(z > kNearest && z < kFarthest)) return 0;
  for (const auto& [column, row] :
       {std::pair(x - 1, y), std::pair(x + 1, y), std::pair(x, y - 1), std::pair(x, y + 1)}) {
    if (column < 0 || row < 0 || column >= camera.width || row >= camera.height) continue;
    if (std::abs(picture.depth[at(column, row)] - z) > kEdge * z) return 0;
  }
  Vec3 normal;
  for (int c = 0; c < 3; ++c) normal[c] = picture.normals[3 * pixel + static_cast<std::size_t>(c)] / 127.5 - 1;
  if (std::abs(glm::dot(normal, camera.ray(pose, x + 0.5, y + 0.5).direction)) < kGrazing) return 0;
  return z + depth_sigma(z) * random.normal(pixel);
}

}  // namespace

Pose walk_pose(int index, int count) {
  const double angle = 2 * kPi * kTurns * index / std::max(1, count - 1);
  const double radius = 1.9 + 0.12 * std::sin(3 * angle + 0.5);
  const double height = 1.35 + 0.12 * std::sin(2.3 * angle);
  // Looks ahead along the path, so that the view changes from place to place.
  const double ahead = angle + 1.0 + 0.12 * std::sin(4.1 * angle);
  return looking({radius * std::cos(angle), radius * std::sin(angle), height},
                 {1.75 * std::cos(ahead), 1.75 * std::sin(ahead), 0.95 + 0.1 * std::sin(1.7 * angle)});
}

double depth_sigma(double z) { return 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4); }

void write_walk(const SynthOptions& options) {
  const std::filesystem::path results = options.output / "results";
  make_folder(results);
  const std::unique_ptr<const World> world = make_room();
  const Intrinsics camera(options.width, options.height);
  Threads threads;
  Picture picture(camera);
  std::vector<std::uint16_t> depth;
  std::string trajectory;
  for (int i = 0; i < options.views; ++i) {
    const Pose pose = walk_pose(i, options.views);
    render_view(*world, camera, pose, options.samples, threads, picture);
    const RandomStream noise(options.seed, 2 + static_cast<std::uint64_t>(i), RandomPurpose::synth);
    depth.assign(picture.depth.size(), 0);
    for (int y = 0; y < camera.height; ++y) {
      for (int x = 0; x < camera.width; ++x) {
        const double z = measured(picture, camera, pose, x, y, noise);
        depth[static_cast<std::size_t>(y) * static_cast<std::size_t>(camera.width) + static_cast<std::size_t>(x)] =
            static_cast<std::uint16_t>(std::lround(std::clamp(z * kDepthScale, 0.0, 65535.0)));
      }
    }
    char name[32];
    std::snprintf(name, sizeof(name), "%06d.png", i);
    write_png(results / (std::string("frame") + name), camera.width, camera.height, 3,
              std::span<const std::uint8_t>(picture.color));
    write_png(results / (std::string("depth") + name), camera.width, camera.height, 1,
              std::span<const std::uint16_t>(depth));
    for (int row = 0; row < 3; ++row) {
      char line[128];
      std::snprintf(line, sizeof(line), "%.9f %.9f %.9f %.9f ", pose.world_from_camera[0][row],
                    pose.world_from_camera[1][row], pose.world_from_camera[2][row], pose.centre[row]);
      trajectory += line;
    }
    trajectory += "0 0 0 1\n";
  }
  write_text_atomically(options.output / "traj.txt", trajectory);
  // In this format, the centre of the first pixel is at (0, 0).
  char text[256];
  std::snprintf(text, sizeof(text),
                "{\"camera\": {\"w\": %d, \"h\": %d, \"fx\": %.9f, \"fy\": %.9f, \"cx\": %.3f, \"cy\": %.3f, "
                "\"scale\": %.1f}}\n",
                camera.width, camera.height, camera.focal, camera.focal, camera.cx - 0.5, camera.cy - 0.5, kDepthScale);
  write_text_atomically(options.output / "cam_params.json", text);
}

}  // namespace splatboost
