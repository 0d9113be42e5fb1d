// SPDX-License-Identifier: Apache-2.0
#include "trainer/synth/synth_picture.h"

#include <cmath>

namespace splatboost::synthetic {
namespace {

constexpr double kFieldOfView = 66.0 * kPi / 180.0;  // horizontal

void take_rows(const World& world, const Intrinsics& camera, const Pose& pose, int samples, std::size_t begin,
               std::size_t end, Picture& picture) {
  const double pixel_angle = 1.0 / camera.focal;
  for (std::size_t row = begin; row < end; ++row) {
    for (int column = 0; column < camera.width; ++column) {
      Vec3 sum(0.0);
      for (int j = 0; j < samples; ++j) {
        for (int i = 0; i < samples; ++i) {
          const double x = column + (i + 0.5) / samples, y = static_cast<double>(row) + (j + 0.5) / samples;
          sum += world.look(camera.ray(pose, x, y), pixel_angle).color;
        }
      }
      sum /= static_cast<double>(samples * samples);
      const Ray ray = camera.ray(pose, column + 0.5, static_cast<double>(row) + 0.5);
      const Seen seen = world.probe(ray);
      const std::size_t pixel = row * static_cast<std::size_t>(camera.width) + static_cast<std::size_t>(column);
      for (int c = 0; c < 3; ++c) {
        const std::size_t at = 3 * pixel + static_cast<std::size_t>(c);
        picture.color[at] = encode_srgb(sum[c]);
        picture.normals[at] = static_cast<std::uint8_t>(std::lround(127.5 * (seen.normal[c] + 1)));
      }
      picture.depth[pixel] = seen.sky ? 0 : seen.distance * glm::dot(ray.direction, pose.world_from_camera[2]);
      picture.mask[pixel] = seen.object ? 255 : 0;
    }
  }
}

}  // namespace

Intrinsics Intrinsics::of(int width, int height) {
  return {width, height, 0.5 * width / std::tan(0.5 * kFieldOfView), 0.5 * width, 0.5 * height};
}

void take_picture(const World& world, const Intrinsics& camera, const Pose& pose, int samples, Threads& threads,
                  Picture& picture) {
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  picture.color.resize(3 * pixels);
  picture.depth.resize(pixels);
  picture.normals.resize(3 * pixels);
  picture.mask.resize(pixels);
  threads.for_range(static_cast<std::size_t>(camera.height), 4, [&](std::size_t begin, std::size_t end) {
    take_rows(world, camera, pose, samples, begin, end, picture);
  });
}

}  // namespace splatboost::synthetic
