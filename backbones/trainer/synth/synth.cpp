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
#include <nlohmann/json.hpp>

#include "splatboost/random.h"
#include "splatboost/threads.h"
#include "trainer/dataset/splat_ply.h"
#include "trainer/formats/colmap.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_values.h"
#include "trainer/support/own_files.h"
#include "trainer/synth/synth_moving.h"
#include "trainer/synth/synth_view.h"
#include "trainer/synth/synth_walk.h"
#include "trainer/synth/synth_world.h"

namespace splatboost {
namespace {

using namespace synthetic;

namespace fs = std::filesystem;

/// Identifies a folder as that of a scene made here, which may be replaced.
constexpr char kMarker[] = "synth.json";
constexpr int kMostPoints = 100'000'000;
constexpr float kMostNoise = 1000;  // metres: far more than any of the scenes measures

void check(const SynthOptions& options) {
  const auto require = [](bool good, const std::string& cause) {
    if (!good) throw InputError("synth: " + cause);
  };
  require(!options.output.empty(), "no output folder is given");
  require(options.scene == "room" || options.scene == "object" || options.scene == "street" ||
              options.scene == "moving" || options.scene == "walk",
          "unknown scene '" + options.scene + "'; known scenes are room, object, street, moving, walk");
  require(options.cameras == 0 || (options.cameras > 0 && options.cameras < options.views),
          std::to_string(options.cameras) +
              " cameras of a rig are not possible; use fewer than --views, or 0 for one moving camera");
  require(options.scene == "moving" || options.cameras == 0, "only the scene 'moving' supports a rig of cameras");
  require(std::isfinite(options.baseline) && options.baseline >= 0 && options.baseline <= 1,
          "the baseline of two cameras must be 0 to 1 m; 0: one camera with depth");
  require(options.scene == "walk" || options.baseline == 0, "only the scene 'walk' supports a pair of cameras");
  require(options.backdrop >= 0 && options.backdrop <= 255, "the grey value of the backdrop must be 0 to 255");
  require(options.scene == "object" || options.backdrop == 0, "only the scene 'object' supports a backdrop");
  require(options.scene != "moving" || options.views >= 2, "the scene 'moving' needs 2 or more views");
  require(options.scene != "moving" || options.surface_points == 0,
          "the scene 'moving' has no surface.ply; the motion of its points is in motion/");
  require(options.scene != "walk" || options.surface_points == 0, "the scene 'walk' has no surface.ply");
  require(options.width >= 16 && options.height >= 16 && options.width <= 8192 && options.height <= 8192,
          "the size " + std::to_string(options.width) + "x" + std::to_string(options.height) +
              " is not possible; both sides must be 16 to 8192");
  require(options.views >= 1 && options.views <= 9999,
          std::to_string(options.views) + " views are not possible; use 1 to 9999");
  const std::string up_to = "are not possible; use 0 to " + std::to_string(kMostPoints);
  require(options.surface_points >= 0 && options.surface_points <= kMostPoints,
          std::to_string(options.surface_points) + " surface points " + up_to);
  require(options.points >= 0 && options.points <= kMostPoints, std::to_string(options.points) + " points " + up_to);
  require(options.samples >= 1 && options.samples <= 16,
          std::to_string(options.samples) + " samples are not possible; use 1 to 16");
  require(options.point_noise >= 0 && options.point_noise <= kMostNoise,
          "the point noise must be 0 to " + std::to_string(static_cast<int>(kMostNoise)) + " m");
  std::error_code error;
  require(!std::filesystem::exists(options.output, error) || std::filesystem::is_directory(options.output, error),
          options.output.string() + " is not a folder");
}

bool is_ours(const fs::path& folder) {
  try {
    return read_json_file(folder / kMarker).contains("splatboost");
  } catch (const InputError&) {
    return false;
  }
}

/// Whether the folder or a folder in it holds anything but folders and working files.
bool holds_files(const fs::path& folder) {
  std::error_code error;
  bool found = false;
  for (fs::recursive_directory_iterator entry(folder, error), end; !found && !error && entry != end;
       entry.increment(error)) {
    found = entry->symlink_status().type() != fs::file_type::directory && !is_working_file(entry->path());
  }
  require(!error, folder.string() + ": cannot be read: " + error.message());
  return found;
}

std::string marker_text(const SynthOptions& options) {
  const nlohmann::json record = {{"splatboost", "synth"},        {"scene", options.scene},
                                 {"width", options.width},       {"height", options.height},
                                 {"views", options.views},       {"cameras", options.cameras},
                                 {"baseline", options.baseline}, {"backdrop", options.backdrop},
                                 {"points", options.points},     {"point-noise", readable(options.point_noise)},
                                 {"samples", options.samples},   {"surface-points", options.surface_points},
                                 {"seed", options.seed}};
  return record.dump(2) + "\n";
}

/// All that a scene of any kind consists of.
constexpr OwnEntry kScene[] = {
    {"images", R"([0-9]+\.png)"},
    // points3D.ply: trainers in Python, and `splatboost points`, write it beside points3D.bin.
    {"sparse", R"(0/((cameras|images|points3D)\.bin|points3D\.ply))"},
    {"depth", R"(((train|test)/)?[0-9]+\.png)"},
    {"normals", R"(((train|test)/)?[0-9]+\.png)"},
    {"masks", R"(((train|test)/)?[0-9]+\.png)"},
    {"surface.ply", {}},
    {"train", R"([0-9]+\.png)"},
    {"test", R"([0-9]+\.png)"},
    {"transforms_train.json", {}},
    {"transforms_test.json", {}},
    {"points3d.ply", {}},
    {"motion", R"([0-9]+\.ply)"},
    {"results", R"((frame|depth)[0-9]+\.png)"},
    {"traj.txt", {}},
    {"cam_params.json", {}},
    {"mav0", R"(cam[01]/(data/[0-9]+\.png|data\.csv|sensor\.yaml)|state_groundtruth_estimate0/data\.csv)"}};

/// Creates the output folder, or takes over that of an earlier scene and removes it. The marker is the first file, so
/// that a killed command can be repeated.
/// @return a lock to hold while the scene is written
FolderLock take_folder(const SynthOptions& options) {
  const fs::path& folder = options.output;
  std::error_code error;
  fs::create_directories(folder, error);
  require(!error, folder.string() + ": cannot create this folder: " + error.message());
  FolderLock lock(folder);
  if (is_ours(folder)) {
    if (const std::optional<fs::path> foreign = find_foreign_file(folder, kScene)) {
      throw InputError(foreign->string() + ": is not of the synthetic scene in " + folder.string() +
                       ", and a new one there would delete it; move it away, or name another folder");
    }
    remove_own_files(folder, kScene);
  } else {
    require(!holds_files(folder), folder.string() + ": contains files, but no " + kMarker +
                                      " of an earlier splatboost synth; name a new or an empty folder");
  }
  remove_stale_files(folder);
  write_text_atomically(folder / kMarker, marker_text(options));
  return lock;
}

}  // namespace

void write_synthetic_scene(const SynthOptions& options) {
  check(options);
  const FolderLock lock = take_folder(options);
  if (options.scene == "moving") return write_moving_scene(options);
  if (options.scene == "walk") return options.baseline > 0 ? write_stereo_walk(options) : write_walk(options);
  for (const char* folder : {"images", "sparse/0", "depth", "normals", "masks"}) {
    make_picture_folder(options.output / folder);
  }

  const std::unique_ptr<const World> world =
      options.scene == "street"   ? make_street()
      : options.scene == "object" ? make_object(srgb(options.backdrop, options.backdrop, options.backdrop))
                                  : make_room();
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

  // The sparse cloud: surface points at random pixels of random views, with noise, like triangulated points. Each view
  // of each scene shows surfaces, so both loops end.
  const auto points = static_cast<std::size_t>(options.points);
  model.points.positions.resize(3 * points);
  model.points.colors.resize(3 * points);
  std::size_t found = 0;
  for (std::uint64_t i = 0; found < points; ++i) {
    const std::uint64_t key = 16 * i;
    const Pose& pose = poses[point_random.below(key, poses.size())];
    const Ray ray =
        camera.ray(pose, camera.width * point_random.uniform(key + 1), camera.height * point_random.uniform(key + 2));
    const Seen seen = world->look(ray, 1.0 / camera.focal);
    if (seen.nothing()) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      // normal(n) uses the random numbers 2n and 2n + 1: here 16i + 4 … 16i + 9.
      const double off = static_cast<double>(options.point_noise) * point_random.normal(8 * i + 2 + k);
      const auto axis = static_cast<glm::length_t>(k);
      model.points.positions[3 * found + k] =
          static_cast<float>((ray.origin + seen.distance * ray.direction)[axis] + off);
      model.points.colors[3 * found + k] = encode_srgb(seen.color[axis]);
    }
    ++found;
  }
  write_colmap_model(options.output / "sparse" / "0", model);
  if (options.surface_points == 0) return;

  const RandomStream surface_random(options.seed, 2, RandomPurpose::synth);
  FloatTable surface{{"x", "y", "z"}, {}};
  const auto surface_points = static_cast<std::size_t>(options.surface_points);
  for (std::uint64_t key = 0; surface.rows() < surface_points; key += 3) {
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
