// SPDX-License-Identifier: Apache-2.0
#include "trainer/synth/synth.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <system_error>
#include <vector>

#include <glm/gtc/quaternion.hpp>

#include "splatboost/random.h"
#include "splatboost/threads.h"
#include "trainer/dataset/splat_ply.h"
#include "trainer/formats/colmap.h"
#include "trainer/support/input_error.h"
#include "trainer/synth/synth_moving.h"
#include "trainer/synth/synth_view.h"
#include "trainer/synth/synth_walk.h"
#include "trainer/synth/synth_world.h"

namespace splatboost {
namespace {

using namespace synthetic;

void check(const SynthOptions& options) {
  const auto require = [](bool good, const std::string& cause) {
    if (!good) throw InputError("synth: " + cause);
  };
  require(!options.output.empty(), "no output folder is given");
  require(options.scene == "room" || options.scene == "street" || options.scene == "moving" || options.scene == "walk",
          "unknown scene '" + options.scene + "'; known scenes are room, street, moving, walk");
  require(options.cameras >= 0 && options.cameras <= options.views,
          std::to_string(options.cameras) +
              " cameras of a rig are not possible; use 1 to --views, or 0 for one moving camera");
  require(options.scene == "moving" || options.cameras == 0, "only the scene 'moving' supports a rig of cameras");
  require(std::isfinite(options.baseline) && options.baseline >= 0 && options.baseline <= 1,
          "the baseline of two cameras must be 0 to 1 m; 0: one camera with depth");
  require(options.scene == "walk" || options.baseline == 0, "only the scene 'walk' supports a pair of cameras");
  require(options.scene != "moving" || options.views >= 2, "the scene 'moving' needs 2 or more views");
  require(options.width >= 16 && options.height >= 16 && options.width <= 8192 && options.height <= 8192,
          "the size " + std::to_string(options.width) + "x" + std::to_string(options.height) +
              " is not possible; both sides must be 16 to 8192");
  require(options.views >= 1 && options.views <= 9999,
          std::to_string(options.views) + " views are not possible; use 1 to 9999");
  require(options.surface_points >= 0,
          std::to_string(options.surface_points) + " surface points are not possible; use 0 or more");
  require(options.points >= 0, std::to_string(options.points) + " points are not possible; use 0 or more");
  require(options.samples >= 1 && options.samples <= 16,
          std::to_string(options.samples) + " samples are not possible; use 1 to 16");
  require(std::isfinite(options.point_noise) && options.point_noise >= 0,
          "the point noise must be a finite number, 0 or more");
  std::error_code error;
  require(!std::filesystem::exists(options.output, error) || std::filesystem::is_directory(options.output, error),
          options.output.string() + " is not a folder");
}

}  // namespace

void write_synthetic_scene(const SynthOptions& options) {
  check(options);
  if (options.scene == "moving") return write_moving_scene(options);
  if (options.scene == "walk") return options.baseline > 0 ? write_stereo_walk(options) : write_walk(options);
  for (const char* folder : {"images", "sparse/0", "depth", "normals", "masks"}) {
    make_picture_folder(options.output / folder);
  }

  const std::unique_ptr<const World> world = options.scene == "street" ? make_street() : make_room();
  const RandomStream camera_random(options.seed, 0, RandomPurpose::synth);
  const RandomStream point_random(options.seed, 1, RandomPurpose::synth);
  const Intrinsics camera(options.width, options.height);
  std::vector<Pose> poses;
  for (int i = 0; i < options.views; ++i) poses.push_back(world->camera(i, options.views, camera_random));

  ColmapModel model;
  model.cameras.push_back({1,
                           1,
                           static_cast<std::uint64_t>(camera.width),
                           static_cast<std::uint64_t>(camera.height),
                           {camera.focal, camera.focal, camera.cx, camera.cy}});
  Threads threads;
  Picture picture(camera);
  for (int i = 0; i < options.views; ++i) {
    const Pose& pose = poses[static_cast<std::size_t>(i)];
    render_view(*world, camera, pose, options.samples, threads, picture);
    char name[16];
    std::snprintf(name, sizeof(name), "%04d.png", i);
    write_picture(options.output, "images", name, camera, picture);

    const Mat3 rotation = glm::transpose(pose.world_from_camera);
    const glm::dquat quaternion = glm::quat_cast(rotation);
    const Vec3 translation = -(rotation * pose.centre);
    ColmapImage image;
    image.id = static_cast<std::uint32_t>(i + 1);
    image.camera_id = 1;
    image.name = name;
    const std::array<double, 4> wxyz{quaternion.w, quaternion.x, quaternion.y, quaternion.z};
    std::copy(wxyz.begin(), wxyz.end(), image.rotation);
    for (int k = 0; k < 3; ++k) image.translation[k] = translation[k];
    model.images.push_back(std::move(image));
  }

  // The sparse cloud: surface points at random pixels of random views, with noise, like triangulated points.
  const auto points = static_cast<std::size_t>(options.points);
  model.points.positions.resize(3 * points);
  model.points.colors.resize(3 * points);
  for (std::size_t i = 0; i < points; ++i) {
    const std::uint64_t key = 16 * i;
    const Pose& pose = poses[point_random.below(key, poses.size())];
    const Ray ray =
        camera.ray(pose, camera.width * point_random.uniform(key + 1), camera.height * point_random.uniform(key + 2));
    const Seen seen = world->look(ray, 1.0 / camera.focal);
    for (int k = 0; k < 3; ++k) {
      const std::size_t at = 3 * i + static_cast<std::size_t>(k);
      // normal(n) uses the random numbers 2n and 2n + 1: here 16i + 4 … 16i + 9.
      const double off =
          static_cast<double>(options.point_noise) * point_random.normal(8 * i + 2 + static_cast<std::uint64_t>(k));
      model.points.positions[at] = static_cast<float>((ray.origin + seen.distance * ray.direction)[k] + off);
      model.points.colors[at] = encode_srgb(seen.color[k]);
    }
  }
  write_colmap_model(options.output / "sparse" / "0", model);
  if (options.surface_points == 0) return;

  const RandomStream surface_random(options.seed, 2, RandomPurpose::synth);
  FloatTable surface{{"x", "y", "z"}, {}};
  for (std::uint64_t key = 0; key < 3 * static_cast<std::uint64_t>(options.surface_points); key += 3) {
    const Pose& pose = poses[surface_random.below(key, poses.size())];
    const Ray ray = camera.ray(pose, camera.width * surface_random.uniform(key + 1),
                               camera.height * surface_random.uniform(key + 2));
    const Seen seen = world->probe(ray);
    if (seen.sky || seen.distance > kFarthestDepth) continue;
    const Vec3 point = ray.origin + seen.distance * ray.direction;
    for (int k = 0; k < 3; ++k) surface.values.push_back(static_cast<float>(point[k]));
  }
  write_float_ply(options.output / "surface.ply", surface);
}

}  // namespace splatboost
