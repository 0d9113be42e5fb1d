// SPDX-License-Identifier: Apache-2.0
#include "trainer/synth/synth.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <string>

#include <glm/geometric.hpp>
#include <glm/vec4.hpp>

#include "support/temporary_folder.h"
#include "trainer/dataset/splat_ply.h"
#include "trainer/dataset/view_image.h"
#include "trainer/formats/read_scene.h"

namespace splatboost::test {
namespace {

SynthOptions small_scene(const std::filesystem::path& output) {
  SynthOptions options;
  options.output = output;
  options.width = 96;
  options.height = 72;
  options.views = 6;
  options.points = 600;
  options.point_noise = 0;
  options.samples = 1;
  return options;
}

Scene read(const std::filesystem::path& source) {
  SceneOptions options;
  options.source = source;
  return read_scene(options);
}

glm::vec3 normal_at(const RawImage& normals, int x, int y) {
  return glm::vec3(normals.at(x, y, 0), normals.at(x, y, 1), normals.at(x, y, 2)) / 127.5f - 1.0f;
}

/// World position of the surface seen at the centre of a pixel.
glm::vec3 world_at(const Camera& camera, const RawImage& depth, int x, int y) {
  const double z = depth.at(x, y) / 1000.0;
  const glm::vec3 p((x + 0.5 - camera.cx) / camera.fx * z, (y + 0.5 - camera.cy) / camera.fy * z, z);
  return glm::transpose(camera.rotation()) * (p - glm::vec3(camera.camera_from_world[3]));
}

/// Every point of the cloud is seen by some camera, and lies within millimetres of the plane through that camera's
/// depth at its pixel. An error of half a pixel (13 mm here) in pose, focal length, principal point or pixel centre
/// fails the test.
TEST(Synth, DepthMapsAgreeWithTheCamerasAndPoints) {
  const TemporaryFolder folder;
  const SynthOptions options = small_scene(folder / "scene");
  write_synthetic_scene(options);
  const Scene scene = read(options.output);
  ASSERT_EQ(scene.train.size(), 6u);
  ASSERT_EQ(scene.points.size(), 600u);

  std::vector<RawImage> depths, normals;
  for (const View& view : scene.train) {
    depths.push_back(read_raw_image(options.output / "depth" / view.name));
    normals.push_back(read_raw_image(options.output / "normals" / view.name));
    ASSERT_EQ(depths.back().bits, 16);
  }
  int seen = 0, close_pairs = 0, on_plane = 0;
  for (std::size_t i = 0; i < scene.points.size(); ++i) {
    const glm::vec3 point(scene.points.positions[3 * i], scene.points.positions[3 * i + 1],
                          scene.points.positions[3 * i + 2]);
    bool agrees = false;
    for (std::size_t k = 0; k < scene.train.size(); ++k) {
      const Camera& camera = scene.train[k].camera;
      const glm::vec4 p = camera.camera_from_world * glm::vec4(point, 1);
      if (p.z <= 0) continue;
      const int x = static_cast<int>(std::floor(camera.fx * p.x / p.z + camera.cx));
      const int y = static_cast<int>(std::floor(camera.fy * p.y / p.z + camera.cy));
      if (x < 0 || y < 0 || x >= camera.width || y >= camera.height) continue;
      if (std::abs(depths[k].at(x, y) / 1000.0 - p.z) > 0.06) continue;  // hidden, or beside a silhouette
      ++close_pairs;
      const bool fits =
          std::abs(glm::dot(normal_at(normals[k], x, y), point - world_at(camera, depths[k], x, y))) < 0.002f;
      on_plane += fits ? 1 : 0;
      agrees |= fits;
    }
    seen += agrees ? 1 : 0;
  }
  EXPECT_GT(close_pairs, 1000);
  EXPECT_GT(on_plane, 0.9 * close_pairs);
  EXPECT_GT(seen, 540);
}

/// Points of surface.ply lie on the surface of some view's depth map; the file is only written on request.
TEST(Synth, SurfacePointsAreWhatTheViewsSee) {
  const TemporaryFolder folder;
  SynthOptions options = small_scene(folder / "scene");
  options.surface_points = 400;
  write_synthetic_scene(options);
  const Scene scene = read(options.output);
  const PointCloud surface = read_point_ply(options.output / "surface.ply");
  ASSERT_EQ(surface.size(), 400u);
  std::vector<RawImage> depths;
  for (const View& view : scene.train) depths.push_back(read_raw_image(options.output / "depth" / view.name));
  int seen = 0;
  for (std::size_t i = 0; i < surface.size(); ++i) {
    const glm::vec4 point(surface.positions[3 * i], surface.positions[3 * i + 1], surface.positions[3 * i + 2], 1);
    bool found = false;
    for (std::size_t v = 0; v < depths.size(); ++v) {
      const View& view = scene.train[v];
      const glm::vec4 p = view.camera.camera_from_world * point;
      const int x = static_cast<int>(std::floor(view.camera.fx * p.x / p.z + view.camera.cx));
      const int y = static_cast<int>(std::floor(view.camera.fy * p.y / p.z + view.camera.cy));
      if (p.z <= 0 || x < 0 || y < 0 || x >= view.camera.width || y >= view.camera.height) continue;
      const double depth = depths[v].at(x, y) / 1000.0;
      found |= std::abs(depth - static_cast<double>(p.z)) < 0.1;
    }
    seen += found ? 1 : 0;
  }
  EXPECT_GT(seen, 390);
  options.output = folder / "without";
  options.surface_points = 0;
  write_synthetic_scene(options);
  EXPECT_FALSE(std::filesystem::exists(options.output / "surface.ply"));
}

/// The street: every point of the cloud lies on the surface that some view's depth shows, or on the sky, which has
/// none; and cameras see it at scales of metres and of tens of metres.
TEST(Synth, StreetIsSeenAtSeveralScalesAndHasExactTruth) {
  const TemporaryFolder folder;
  SynthOptions options = small_scene(folder / "scene");
  options.scene = "street";
  options.views = 10;
  write_synthetic_scene(options);
  const Scene scene = read(options.output);
  ASSERT_EQ(scene.train.size(), 10u);
  ASSERT_EQ(scene.points.size(), 600u);
  std::vector<RawImage> depths;
  std::vector<double> median_depths;
  int sky = 0;
  for (const View& view : scene.train) {
    depths.push_back(read_raw_image(options.output / "depth" / view.name));
    std::vector<double> all;
    for (int y = 0; y < options.height; ++y) {
      for (int x = 0; x < options.width; ++x) {
        if (depths.back().at(x, y) == 0) ++sky;
        all.push_back(depths.back().at(x, y) == 0 ? 70 : depths.back().at(x, y) / 1000.0);
      }
    }
    std::nth_element(all.begin(), all.begin() + 3456, all.end());
    median_depths.push_back(all[3456]);
  }
  EXPECT_GT(sky, 2000);
  EXPECT_LT(*std::min_element(median_depths.begin(), median_depths.end()), 3);
  EXPECT_GT(*std::max_element(median_depths.begin(), median_depths.end()), 10);
  int on_surface = 0;
  for (std::size_t i = 0; i < scene.points.size(); ++i) {
    const glm::vec4 point(scene.points.positions[3 * i], scene.points.positions[3 * i + 1],
                          scene.points.positions[3 * i + 2], 1);
    bool agrees = false;
    for (std::size_t k = 0; k < scene.train.size(); ++k) {
      const Camera& camera = scene.train[k].camera;
      const glm::vec4 p = camera.camera_from_world * point;
      if (p.z <= 0) continue;
      const int x = static_cast<int>(std::floor(camera.fx * p.x / p.z + camera.cx));
      const int y = static_cast<int>(std::floor(camera.fy * p.y / p.z + camera.cy));
      if (x < 0 || y < 0 || x >= camera.width || y >= camera.height) continue;
      const int depth = depths[k].at(x, y);
      agrees |= depth == 0 ? glm::length(glm::vec3(point)) > 60 : std::abs(depth / 1000.0 - p.z) < 0.02 * p.z;
    }
    on_surface += agrees ? 1 : 0;
  }
  EXPECT_GT(on_surface, 540);
}

/// The depth of one view, projected into another view, must match that view's depth where it is not occluded. Normals
/// must be those of the depth.
TEST(Synth, DepthAndNormalsAgreeAcrossViews) {
  const TemporaryFolder folder;
  const SynthOptions options = small_scene(folder / "scene");
  write_synthetic_scene(options);
  const Scene scene = read(options.output);
  const auto load = [&](const char* kind, const View& view) {
    return read_raw_image(options.output / kind / view.name);
  };
  const View &first = scene.train[0], &second = scene.train[1];
  const RawImage depth = load("depth", first), other = load("depth", second), normals = load("normals", first);
  const RawImage mask = load("masks", first);
  int flat = 0, normal_agrees = 0, common = 0, depth_agrees = 0, objects = 0;
  for (int y = 1; y + 1 < options.height; ++y) {
    for (int x = 1; x + 1 < options.width; ++x) {
      objects += mask.at(x, y) != 0 ? 1 : 0;
      const glm::vec3 p = world_at(first.camera, depth, x, y);
      const auto at = [&](int i, int j) { return world_at(first.camera, depth, x + i, y + j); };
      const glm::vec3 across = glm::cross(at(0, 1) - at(0, -1), at(1, 0) - at(-1, 0));
      const glm::vec3 normal = normal_at(normals, x, y);
      EXPECT_NEAR(glm::length(normal), 1, 0.02);
      ++flat;
      normal_agrees += glm::dot(glm::normalize(across), normal) > 0.95f ? 1 : 0;

      const glm::vec4 q = second.camera.camera_from_world * glm::vec4(p, 1);
      const int u = static_cast<int>(std::floor(second.camera.fx * q.x / q.z + second.camera.cx));
      const int v = static_cast<int>(std::floor(second.camera.fy * q.y / q.z + second.camera.cy));
      if (q.z <= 0 || u < 0 || v < 0 || u >= options.width || v >= options.height) continue;
      ++common;
      depth_agrees += std::abs(other.at(u, v) / 1000.0 - q.z) < 0.05 ? 1 : 0;
    }
  }
  EXPECT_GT(normal_agrees, 0.75 * flat);
  EXPECT_GT(common, 500);
  EXPECT_GT(depth_agrees, 0.5 * common);  // the rest is occluded in the other view
  EXPECT_GT(objects, 0.1 * flat);
  EXPECT_LT(objects, 0.9 * flat);
}

/// A captured object: its surfaces fill much of each view, the rest is black and has no depth, no point and no mask.
TEST(Synth, AnObjectIsInFrontOfBlack) {
  const TemporaryFolder folder;
  SynthOptions options = small_scene(folder / "scene");
  options.scene = "object";
  options.views = 12;
  options.surface_points = 400;
  write_synthetic_scene(options);
  const Scene scene = read(options.output);
  ASSERT_EQ(scene.train.size(), 12u);
  ASSERT_EQ(scene.points.size(), 600u);
  for (const View& view : scene.train) {
    const RawImage depth = read_raw_image(options.output / "depth" / view.name);
    const RawImage mask = read_raw_image(options.output / "masks" / view.name);
    const std::size_t pixels = view.color.size() / 3;
    int seen = 0, bright = 0;
    for (int y = 0; y < options.height; ++y) {
      for (int x = 0; x < options.width; ++x) {
        const auto pixel = static_cast<std::size_t>(y * options.width + x);
        const int sum = view.color[pixel] + view.color[pixels + pixel] + view.color[2 * pixels + pixel];
        EXPECT_EQ(depth.at(x, y) != 0, mask.at(x, y) == 255);
        if (depth.at(x, y) == 0) bright += sum;
        seen += depth.at(x, y) != 0 ? 1 : 0;
        EXPECT_LT(depth.at(x, y), 4000) << "a wall";
      }
    }
    EXPECT_EQ(bright, 0) << view.name;
    EXPECT_GT(seen, options.width * options.height / 4) << view.name;
    EXPECT_LT(seen, options.width * options.height * 9 / 10) << view.name;
  }
  const FloatTable surface = read_float_ply(options.output / "surface.ply", {"x", "y", "z"});
  ASSERT_EQ(surface.rows(), 400u);
  const auto on_podium = [](float x, float y, float z) { return std::hypot(x, y) < 1.19f && z > -0.01f && z < 1.4f; };
  for (std::size_t i = 0; i < 400; ++i) {
    EXPECT_TRUE(on_podium(surface.values[3 * i], surface.values[3 * i + 1], surface.values[3 * i + 2])) << i;
  }
  for (std::size_t i = 0; i < 600; ++i) {
    const float* p = &scene.points.positions[3 * i];
    EXPECT_TRUE(on_podium(p[0], p[1], p[2])) << i;
  }
}

TEST(Synth, ABackdropIsSeenBesideTheObjectOnly) {
  const TemporaryFolder folder;
  SynthOptions options = small_scene(folder / "black");
  options.scene = "object";
  options.views = 3;
  write_synthetic_scene(options);
  const Scene black = read(options.output);
  options.output = folder / "grey";
  options.backdrop = 200;
  write_synthetic_scene(options);
  const Scene grey = read(options.output);
  EXPECT_EQ(grey.points.positions, black.points.positions);
  for (std::size_t v = 0; v < 3; ++v) {
    const View& view = grey.train[v];
    const RawImage depth = read_raw_image(options.output / "depth" / view.name);
    const std::size_t pixels = view.color.size() / 3;
    for (std::size_t i = 0; i < view.color.size(); ++i) {
      const int x = static_cast<int>(i % pixels) % options.width, y = static_cast<int>(i % pixels) / options.width;
      ASSERT_EQ(view.color[i], depth.at(x, y) == 0 ? 200 : black.train[v].color[i])
          << view.name << ", " << x << ", " << y;
    }
  }
}

TEST(Synth, SameSeedSameBytesOtherSeedOtherBytes) {
  const TemporaryFolder folder;
  for (const char* name : {"a", "b", "c"}) {
    SynthOptions options = small_scene(folder / name);
    options.views = 2;
    options.point_noise = 0.01f;
    options.seed = *name == 'c' ? 1 : 0;
    write_synthetic_scene(options);
  }
  for (const char* name : {"images/0001.png", "depth/0001.png", "normals/0001.png", "masks/0001.png",
                           "sparse/0/images.bin", "sparse/0/points3D.bin"}) {
    EXPECT_TRUE(read_file(folder.path() / "a" / name) == read_file(folder.path() / "b" / name)) << name;
    EXPECT_FALSE(read_file(folder.path() / "a" / name) == read_file(folder.path() / "c" / name)) << name;
  }
}

/// All files below the folder, by their path.
std::map<std::string, std::string> content(const std::filesystem::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) files[entry.path().lexically_relative(folder).string()] = read_file(entry.path());
  }
  return files;
}

TEST(Synth, NothingOfAnEarlierSceneStays) {
  const TemporaryFolder folder;
  const auto write = [&](const char* name, const char* kind, double baseline, int surface_points) {
    SynthOptions options = small_scene(folder / name);
    options.scene = kind;
    options.views = 2;
    options.points = 20;
    options.baseline = baseline;
    options.surface_points = surface_points;
    write_synthetic_scene(options);
  };
  write("twice", "room", 0, 10);
  write("twice", "moving", 0, 0);
  write("twice", "walk", 0, 0);
  write("twice", "walk", 0.1, 0);
  write("twice", "room", 0, 0);
  write("fresh", "room", 0, 0);
  EXPECT_TRUE(content(folder / "twice") == content(folder / "fresh"));
}

TEST(Synth, AFolderWithOtherFilesIsRefused) {
  const TemporaryFolder folder;
  write_file(folder / "scene/results/depth000002.png", "measured");
  expect_contains(input_error_of([&] { write_synthetic_scene(small_scene(folder / "scene")); }), "no synth.json");
  write_file(folder / "scene/synth.json", "of something else");
  expect_contains(input_error_of([&] { write_synthetic_scene(small_scene(folder / "scene")); }), "empty folder");
  EXPECT_EQ(content(folder / "scene").size(), 2u);
}

TEST(Synth, PhotosAreExposedAndTextured) {
  const TemporaryFolder folder;
  SynthOptions options = small_scene(folder / "scene");
  options.samples = 2;
  write_synthetic_scene(options);
  const Scene scene = read(options.output);
  for (const View& view : scene.train) {
    double sum = 0, clipped = 0, steps = 0;
    for (std::size_t i = 0; i < view.color.size(); ++i) {
      sum += view.color[i];
      clipped += view.color[i] == 255 || view.color[i] == 0 ? 1 : 0;
      if (i % static_cast<std::size_t>(options.width) != 0) steps += std::abs(view.color[i] - view.color[i - 1]);
    }
    const auto n = static_cast<double>(view.color.size());
    EXPECT_GT(sum / n, 60) << view.name;
    EXPECT_LT(sum / n, 190) << view.name;
    EXPECT_LT(clipped / n, 0.02) << view.name;
    EXPECT_GT(steps / n, 6) << view.name;
  }
}

/// Fraction of the pixels that project into the other view whose depth matches there.
double agreement(const View& from, const RawImage& depth, const View& to, const RawImage& depth_there) {
  double inside = 0, agree = 0;
  for (int y = 0; y < depth.height; y += 2) {
    for (int x = 0; x < depth.width; x += 2) {
      const glm::vec3 p = glm::vec3(to.camera.camera_from_world * glm::vec4(world_at(from.camera, depth, x, y), 1.0f));
      const auto column = static_cast<int>(std::floor(to.camera.fx * p.x / p.z + to.camera.cx));
      const auto row = static_cast<int>(std::floor(to.camera.fy * p.y / p.z + to.camera.cy));
      if (p.z <= 0 || column < 0 || row < 0 || column >= depth.width || row >= depth.height) continue;
      inside += 1;
      agree += std::abs(depth_there.at(column, row) / 1000.0 - static_cast<double>(p.z)) < 0.05;
    }
  }
  return agree / inside;
}

TEST(Synth, ARigSeesTheSameAtOneTimeAndThingsMoveBetweenTimes) {
  const TemporaryFolder folder;
  SynthOptions options = small_scene(folder / "scene");
  options.scene = "moving";
  options.views = 8;
  options.cameras = 4;
  write_synthetic_scene(options);
  SceneOptions read_options;
  read_options.source = options.output;
  read_options.eval = true;
  const Scene scene = read_scene(read_options);
  ASSERT_EQ(scene.train.size(), 8u);
  ASSERT_EQ(scene.test.size(), 2u);
  ASSERT_EQ(scene.points.size(), 600u);
  const auto depth_of = [&](const View& view) { return read_raw_image(options.output / "depth" / view.name); };
  // Cameras 0 and 1 are 90° apart; views 4 to 7 are the same four cameras at another time.
  EXPECT_EQ(scene.train[0].time, 0);
  EXPECT_EQ(scene.train[1].time, 0);
  EXPECT_EQ(scene.train[5].time, 1);
  EXPECT_EQ(scene.train[1].camera.camera_from_world, scene.train[5].camera.camera_from_world);
  EXPECT_NE(scene.train[1].color, scene.train[5].color);
  const double same = agreement(scene.train[0], depth_of(scene.train[0]), scene.train[1], depth_of(scene.train[1]));
  EXPECT_GT(same, 0.35) << "the rest hides behind something";
  // Only the objects on the podium move: the same camera sees most of the room at the same depth.
  const double later = agreement(scene.train[1], depth_of(scene.train[1]), scene.train[5], depth_of(scene.train[5]));
  EXPECT_GT(later, 0.7);
  EXPECT_LT(later, 0.995);
  for (const View& view : scene.test) {
    for (const View& seen : scene.train) {
      EXPECT_FALSE(view.time == seen.time || view.camera.camera_from_world == seen.camera.camera_from_world);
    }
  }
}

/// Rows of motion/*.ply are points of points3d.ply: each file holds where they are at its time.
TEST(Synth, NoTrainingViewShowsATestTime) {
  const TemporaryFolder folder;
  for (const auto& [views, cameras] : {std::pair{49, 0}, {75, 3}, {8, 4}}) {
    SynthOptions options = small_scene(folder / ("scene" + std::to_string(views)));
    options.scene = "moving";
    options.views = views;
    options.cameras = cameras;
    options.width = 24;
    options.height = 18;
    write_synthetic_scene(options);
    SceneOptions read_options;
    read_options.source = options.output;
    read_options.eval = true;
    const Scene scene = read_scene(read_options);
    const float gap = 1.0f / static_cast<float>((cameras > 0 ? views / cameras : views) - 1);
    for (const View& test : scene.test) {
      for (const View& train : scene.train) {
        EXPECT_GT(std::abs(test.time - train.time), 0.2f * gap) << views << ' ' << test.name << ' ' << train.name;
      }
    }
  }
}

TEST(Synth, TheMotionOfSurfacePointsIsKnown) {
  const TemporaryFolder folder;
  SynthOptions options = small_scene(folder / "scene");
  options.scene = "moving";
  options.points = 4000;
  write_synthetic_scene(options);
  const auto positions = [&](const std::string& file) {
    const FloatTable table = read_float_ply(options.output / file, {"x", "y", "z"});
    std::vector<glm::vec3> rows;
    for (std::size_t i = 0; i < table.rows(); ++i)
      rows.emplace_back(table.values[3 * i], table.values[3 * i + 1], table.values[3 * i + 2]);
    return rows;
  };
  const std::vector<glm::vec3> seen = positions("points3d.ply");
  std::vector<std::vector<glm::vec3>> at;
  for (int k = 0; k <= 20; ++k)
    at.push_back(positions("motion/000" + std::string(k < 10 ? "0" : "") + std::to_string(k) + ".ply"));
  EXPECT_FALSE(std::filesystem::exists(options.output / "motion/00021.ply"));

  // The beach ball: its centre and its turn about y at a time.
  const auto centre = [](int k) {
    const double phase = 0.25 * k / 20.0;
    return glm::vec3(-0.5 + phase, -0.72, 0.16 + 0.17 + 0.45 * std::abs(std::sin(3 * 3.141592653589793 * phase)));
  };
  const auto on_ball = [&](std::size_t i, int k) {
    return std::abs(glm::length(at[static_cast<std::size_t>(k)][i] - centre(k)) - 0.17f) < 1e-4f;
  };
  std::size_t of_ball = 0, still = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    float nearest = 1e9f, most = 0;
    for (std::size_t k = 0; k < at.size(); ++k) {
      ASSERT_EQ(at[k].size(), seen.size());
      if (k % 4 == 0) nearest = std::min(nearest, glm::length(at[k][i] - seen[i]));  // the times of the six views
      most = std::max(most, glm::length(at[k][i] - at[0][i]));
    }
    EXPECT_LT(nearest, 1e-5f) << "where a view saw it";
    still += most < 1e-5f;
    if (!on_ball(i, 0) || !on_ball(i, 13)) continue;
    ++of_ball;
    const glm::vec3 start = at[0][i] - centre(0);
    for (int k = 0; k <= 20; ++k) {
      const auto angle = static_cast<float>(-4 * 0.25 * k / 20.0);
      const float c = std::cos(angle), s = std::sin(angle);
      const glm::vec3 turned(c * start.x + s * start.z, start.y, c * start.z - s * start.x);
      EXPECT_LT(glm::length(at[static_cast<std::size_t>(k)][i] - centre(k) - turned), 1e-4f) << k;
    }
  }
  EXPECT_GT(of_ball, 5u);
  EXPECT_GT(still, seen.size() / 2) << "the room";
  EXPECT_LT(still, seen.size() - 100);
}

TEST(Synth, OneCameraWalksAroundWhatMoves) {
  const TemporaryFolder folder;
  SynthOptions options = small_scene(folder / "scene");
  options.scene = "moving";
  write_synthetic_scene(options);
  const Scene scene = read(options.output);
  ASSERT_EQ(scene.train.size(), 8u) << "without --eval nothing is held out";
  for (std::size_t i = 0; i < 6; ++i) EXPECT_FLOAT_EQ(scene.train[i].time, static_cast<float>(i) / 5);
  EXPECT_TRUE(scene.synthetic);
}

TEST(Synth, ImpossibleOptionsAreInputErrors) {
  const TemporaryFolder folder;
  const auto error_with = [&](auto&& change) {
    SynthOptions options = small_scene(folder / "scene");
    change(options);
    return input_error_of([&] { write_synthetic_scene(options); });
  };
  expect_contains(error_with([](SynthOptions& o) { o.views = 0; }), "0 views");
  expect_contains(error_with([](SynthOptions& o) { o.width = 3; }), "3x72");
  expect_contains(error_with([](SynthOptions& o) { o.samples = 0; }), "samples");
  expect_contains(error_with([](SynthOptions& o) { o.points = -1; }), "points");
  expect_contains(error_with([](SynthOptions& o) { o.points = 100'000'001; }), "100000001 points are not possible");
  expect_contains(error_with([](SynthOptions& o) { o.surface_points = 2'000'000'000; }),
                  "2000000000 surface points are not possible; use 0 to 100000000");
  expect_contains(error_with([](SynthOptions& o) { o.point_noise = 1001; }), "the point noise must be 0 to 1000 m");
  expect_contains(error_with([](SynthOptions& o) { o.point_noise = std::numeric_limits<float>::quiet_NaN(); }),
                  "noise");
  expect_contains(error_with([](SynthOptions& o) { o.cameras = 2; }), "only the scene 'moving'");
  expect_contains(error_with([](SynthOptions& o) { o.scene = "moving", o.cameras = 7; }), "7 cameras");
  expect_contains(error_with([](SynthOptions& o) { o.scene = "moving", o.cameras = o.views; }), "fewer than --views");
  expect_contains(error_with([](SynthOptions& o) { o.scene = "moving", o.views = 1; }), "2 or more views");
  expect_contains(error_with([](SynthOptions& o) { o.scene = "moving", o.surface_points = 9; }), "no surface.ply");
  expect_contains(error_with([](SynthOptions& o) { o.scene = "walk", o.surface_points = 9; }), "no surface.ply");
  expect_contains(error_with([](SynthOptions& o) { o.backdrop = 9; }), "only the scene 'object' supports a backdrop");
  expect_contains(error_with([](SynthOptions& o) { o.scene = "object", o.backdrop = 256; }), "must be 0 to 255");
  expect_contains(error_with([](SynthOptions& o) { o.scene = "object", o.backdrop = -1; }), "must be 0 to 255");
  expect_contains(error_with([](SynthOptions& o) { o.output.clear(); }), "output");
  write_file(folder / "file", "x");
  expect_contains(error_with([&](SynthOptions& o) { o.output = folder / "file"; }), "not a folder");
}

}  // namespace
}  // namespace splatboost::test
