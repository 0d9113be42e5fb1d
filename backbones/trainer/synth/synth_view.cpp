// SPDX-License-Identifier: Apache-2.0
#include "trainer/synth/synth_view.h"

#include <span>
#include <system_error>

#include "trainer/dataset/view_image.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

namespace splatboost::synthetic {
namespace {

void render_rows(const World& world, const Intrinsics& camera, const Pose& pose, int samples, std::size_t begin,
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

void render_view(const World& world, const Intrinsics& camera, const Pose& pose, int samples, const Threads& threads,
                 Picture& picture) {
  threads.for_range(static_cast<std::size_t>(camera.height), 4, [&](std::size_t begin, std::size_t end) {
    render_rows(world, camera, pose, samples, begin, end, picture);
  });
}

void make_picture_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw InputError(folder.string() + ": cannot create this folder: " + error.message());
  remove_stale_files(folder);
}

void write_picture(const std::filesystem::path& output, const std::string& colors, const std::string& name,
                   const Intrinsics& camera, const Picture& picture) {
  const auto bytes = [](const std::vector<std::uint8_t>& values) { return std::span<const std::uint8_t>(values); };
  std::vector<std::uint16_t> millimetres;
  for (const double z : picture.depth) {
    millimetres.push_back(z < kFarthestDepth ? static_cast<std::uint16_t>(std::lround(1000 * z)) : std::uint16_t{0});
  }
  write_png(output / colors / name, camera.width, camera.height, 3, bytes(picture.color));
  write_png(output / "depth" / name, camera.width, camera.height, 1, std::span<const std::uint16_t>(millimetres));
  write_png(output / "normals" / name, camera.width, camera.height, 3, bytes(picture.normals));
  write_png(output / "masks" / name, camera.width, camera.height, 1, bytes(picture.mask));
}

}  // namespace splatboost::synthetic
