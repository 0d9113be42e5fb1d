// SPDX-License-Identifier: Apache-2.0
// A room in which objects fly (rigid), an arm swings (articulated) and a stalk bends, seen by one camera that walks
// around, or by a rig.
#include "trainer/synth/synth_moving.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include <glm/gtc/quaternion.hpp>
#include <nlohmann/json.hpp>

#include "splatboost/random.h"
#include "splatboost/threads.h"
#include "trainer/dataset/splat_ply.h"
#include "trainer/support/atomic_file.h"
#include "trainer/synth/synth_room_surfaces.h"
#include "trainer/synth/synth_view.h"

namespace splatboost {
namespace synthetic {

using namespace room;

namespace {

/// Periods of the swinging motions from time 0 to 1. With a whole period, published runs of Deformable-3DGS of several
/// thousand iterations learned none of the motion.
constexpr double kPeriods = 0.25;

/// The solids at a time, in the same order at every time.
std::vector<Solid> moving_solids(double time) {
  const double phase = kPeriods * time, turn = 2 * kPi * phase;
  const auto about = [](double angle, const Vec3& axis) { return glm::mat3_cast(glm::angleAxis(angle, axis)); };
  std::vector<Solid> solids;
  const auto add = [&](Shape shape, Material material, Vec3 size, Vec3 position, Mat3 world_from_local = Mat3(1.0)) {
    solids.push_back(make_solid(shape, material, size, position, glm::transpose(world_from_local)));
  };
  add(Shape::cylinder, Material::podium, {1.18, 0, kPodiumHeight}, {0, 0, 0});

  // Static objects.
  add(Shape::cone, Material::spiral, {0.22, 0, 0.6}, {-0.42, 0.72, kPodiumHeight});
  add(Shape::box, Material::stone, Vec3(0.25, 0.25, 0.12), {0.02, 0.05, kPodiumHeight + 0.12}, about(0.3, {0, 0, 1}));
  add(Shape::cylinder, Material::can, {0.15, 0, 0.4}, {0.72, -0.52, kPodiumHeight}, about(1, {0, 0, 1}));

  // Rigid motion: a globe rises and turns above the stone, a ball hops across, a ring rolls.
  add(Shape::sphere, Material::globe, Vec3(0.26), {0.02, 0.05, kPodiumHeight + 0.62 + 0.22 * std::sin(turn)},
      about(1.6 * turn / 2, glm::normalize(Vec3(0.2, 0.3, 1))));
  add(Shape::sphere, Material::beach_ball, Vec3(0.17),
      {-0.5 + phase, -0.72, kPodiumHeight + 0.17 + 0.45 * std::abs(std::sin(1.5 * turn))},
      about(-4 * phase, {0, 1, 0}));
  const double rolled = 0.9 * phase;  // metres, along y
  add(Shape::torus, Material::candy, {0.16, 0.06, 0}, {0.95, -0.35 + rolled, kPodiumHeight + 0.22},
      about(-rolled / 0.22, {1, 0, 0}) * about(kPi / 2, {0, 1, 0}));

  // Articulated: two links on a pillar.
  const Vec3 shoulder(-0.68, -0.25, kPodiumHeight + 0.34);
  add(Shape::cylinder, Material::mosaic, {0.11, 0, 0.34}, {shoulder.x, shoulder.y, kPodiumHeight});
  const Mat3 upper = about(0.5 * std::sin(turn), {0, 0, 1}) * about(0.35 + 0.55 * std::sin(turn + 0.6), {1, 0, 0});
  const Mat3 lower = upper * about(-0.9 - 0.7 * std::cos(turn), {1, 0, 0});
  constexpr double kUpper = 0.2, kLower = 0.17;  // half lengths
  const Vec3 elbow = shoulder + upper * Vec3(0, 0, 2 * kUpper);
  add(Shape::box, Material::crate, {0.065, 0.065, kUpper}, shoulder + upper * Vec3(0, 0, kUpper), upper);
  add(Shape::sphere, Material::marble, Vec3(0.085), elbow, upper);
  add(Shape::box, Material::stone, {0.05, 0.05, kLower}, elbow + lower * Vec3(0, 0, kLower), lower);
  add(Shape::sphere, Material::bronze, Vec3(0.09), elbow + lower * Vec3(0, 0, 2 * kLower), lower);

  // Bending: a stalk of beads, each a little more inclined than the one below.
  Vec3 at(0.5, 0.55, kPodiumHeight + 0.05);
  Mat3 frame(1.0);
  const Mat3 bend = about(0.2 * std::sin(turn), {1, 0, 0}) * about(0.16 * std::cos(turn) - 0.05, {0, 1, 0});
  constexpr int kBeads = 10;
  for (int bead = 0; bead < kBeads; ++bead) {
    add(Shape::sphere, Material::mosaic, Vec3(0.095 - 0.004 * bead), at, frame);
    frame = frame * bend;
    at += frame * Vec3(0, 0, 0.095);
  }
  return solids;
}

}  // namespace

std::unique_ptr<World> make_moving_room(double time) { return make_room_of(moving_solids(time)); }

}  // namespace synthetic

namespace {

using namespace synthetic;

/// An image to render.
struct Shot {
  Pose pose;
  double time = 0;
};

struct Film {
  std::vector<Shot> train, test;
};

Film plan(const SynthOptions& options) {
  const RandomStream random(options.seed, 0, RandomPurpose::synth), test_random(options.seed, 2, RandomPurpose::synth);
  const std::unique_ptr<const World> room = make_moving_room(0);
  Film film;
  const int moments = options.cameras > 0 ? (options.views + options.cameras - 1) / options.cameras : options.views;
  for (int i = 0; i < options.views; ++i) {
    const int moment = options.cameras > 0 ? i / options.cameras : i;
    const double time = moments > 1 ? static_cast<double>(moment) / (moments - 1) : 0;
    film.train.push_back({options.cameras > 0 ? room->camera(i % options.cameras, options.cameras, random)
                                              : room->camera(i, options.views, random),
                          time});
  }
  // Times between training times, and not near one, from poses other than the training camera's at that time.
  const int tests = std::max(2, options.views / 6);
  const double gaps = std::max(1, moments - 1);
  for (int i = 0; i < tests; ++i) {
    const int place = (i + tests / 2) % tests;
    const double at = (i + 0.5) / tests * gaps, before = std::floor(at);
    film.test.push_back(
        {room->camera(place, tests, test_random), (before + std::clamp(at - before, 0.25, 0.75)) / gaps});
  }
  return film;
}

/// Camera to world in OpenGL's convention, as Blender writes it.
nlohmann::json matrix_of(const Pose& pose) {
  nlohmann::json rows = nlohmann::json::array();
  for (int row = 0; row < 3; ++row) {
    rows.push_back({pose.world_from_camera[0][row], -pose.world_from_camera[1][row], -pose.world_from_camera[2][row],
                    pose.centre[row]});
  }
  rows.push_back({0.0, 0.0, 0.0, 1.0});
  return rows;
}

/// Where points of surfaces are at evenly spaced times from 0 to 1. Files are named as those of `render --sequence`.
class Motion {
 public:
  Motion() {
    for (int k = 0; k < kTimes; ++k) solids_.push_back(moving_solids(static_cast<double>(k) / (kTimes - 1)));
    tables_.resize(kTimes, FloatTable{{"x", "y", "z"}, {}});
  }

  /// @param point seen at `time` @param solid Seen::solid of it
  void add(const Vec3& point, int solid, double time) {
    const auto s = static_cast<std::size_t>(solid);
    Vec3 local(0.0);
    if (solid >= 0) {
      const Solid now = moving_solids(time)[s];
      local = now.local_from_world * (point - now.position);
    }
    for (std::size_t k = 0; k < tables_.size(); ++k) {
      Vec3 there = point;
      if (solid >= 0) there = solids_[k][s].position + glm::transpose(solids_[k][s].local_from_world) * local;
      for (int axis = 0; axis < 3; ++axis) tables_[k].values.push_back(static_cast<float>(there[axis]));
    }
  }

  void write(const std::filesystem::path& folder) const {
    make_picture_folder(folder);
    for (std::size_t k = 0; k < tables_.size(); ++k) {
      char name[32];
      std::snprintf(name, sizeof name, "%05zu.ply", k);
      write_float_ply(folder / name, tables_[k]);
    }
  }

 private:
  static constexpr int kTimes = 21;
  std::vector<std::vector<Solid>> solids_;  ///< at each time
  std::vector<FloatTable> tables_;          ///< at each time
};

}  // namespace

void write_moving_scene(const SynthOptions& options) {
  const Film film = plan(options);
  const Intrinsics camera(options.width, options.height);
  Threads threads;
  Picture picture(camera);
  for (const std::string split : {"train", "test"}) {
    for (const std::string& folder : {split, "depth/" + split, "normals/" + split, "masks/" + split}) {
      make_picture_folder(options.output / folder);
    }
    const std::vector<Shot>& shots = split == "train" ? film.train : film.test;
    nlohmann::json frames = nlohmann::json::array();
    for (std::size_t i = 0; i < shots.size(); ++i) {
      char number[32];
      std::snprintf(number, sizeof number, "%04zu", i);
      const std::string name = split + "/" + number;
      render_view(*make_moving_room(shots[i].time), camera, shots[i].pose, options.samples, threads, picture);
      write_picture(options.output, ".", name + ".png", camera, picture);
      frames.push_back(
          {{"file_path", "./" + name}, {"time", shots[i].time}, {"transform_matrix", matrix_of(shots[i].pose)}});
    }
    const nlohmann::json json{{"camera_angle_x", kFieldOfView}, {"frames", frames}};
    write_text_atomically(options.output / ("transforms_" + split + ".json"), json.dump(1) + "\n");
  }

  // Surface points at random pixels of random training views, at the time of the view.
  const RandomStream random(options.seed, 1, RandomPurpose::synth);
  PointCloud points;
  Motion motion;
  for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(options.points); ++i) {
    const std::uint64_t key = 16 * i;
    const Shot& shot = film.train[random.below(key, film.train.size())];
    const Ray ray =
        camera.ray(shot.pose, camera.width * random.uniform(key + 1), camera.height * random.uniform(key + 2));
    const Seen seen = make_moving_room(shot.time)->look(ray, 1.0 / camera.focal);
    motion.add(ray.origin + seen.distance * ray.direction, seen.solid, shot.time);
    for (int k = 0; k < 3; ++k) {
      const double off =
          static_cast<double>(options.point_noise) * random.normal(8 * i + 2 + static_cast<std::uint64_t>(k));
      points.positions.push_back(static_cast<float>((ray.origin + seen.distance * ray.direction)[k] + off));
    }
    for (int k = 0; k < 3; ++k) points.colors.push_back(encode_srgb(seen.color[k]));
  }
  write_point_ply(options.output / "points3d.ply", points);
  motion.write(options.output / "motion");
}

}  // namespace splatboost
