// SPDX-License-Identifier: Apache-2.0
#include "trainer/points/triangulated_points.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <memory>
#include <span>

#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>

#include "support/temporary_folder.h"
#include "trainer/dataset/splat_ply.h"
#include "trainer/features/feature_tracks.h"
#include "trainer/features/nearest_to_lines.h"
#include "trainer/features/view_features.h"
#include "trainer/formats/read_scene.h"
#include "trainer/images/image_codec.h"
#include "trainer/points/backdrop_points.h"
#include "trainer/points/gap_points.h"
#include "trainer/points/initial_points.h"
#include "trainer/synth/synth.h"

namespace splatboost::test {
namespace {

/// The ray-traced room, with exact points on its surfaces.
class TriangulatedPoints : public ::testing::Test {
 protected:
  static constexpr double kSpacing = 0.03;  ///< × diagonal of a picture: 6 px

  static void SetUpTestSuite() {
    folder = std::make_unique<TemporaryFolder>();
    SynthOptions synth;
    synth.output = folder->path() / "room";
    synth.width = 160;
    synth.height = 120;
    synth.views = 24;
    synth.surface_points = 50000;
    write_synthetic_scene(synth);
    SceneOptions options;
    options.source = synth.output;
    views = std::make_unique<std::vector<View>>(read_scene(options).train);
    surface = std::make_unique<PointCloud>(read_point_ply(synth.output / "surface.ply"));
  }
  static void TearDownTestSuite() {
    folder.reset();
    views.reset();
    surface.reset();
  }
  void SetUp() override {
    if (!have_opencv()) GTEST_SKIP() << "a build without OpenCV finds no features";
  }

  static Scene scene_of(const std::vector<View>& train) {
    Scene scene;
    scene.train = train;
    return scene;
  }

  /// The steps of triangulate_points().
  struct Matched {
    explicit Matched(const std::vector<View>& from) {
      for (const View& view : from) features.push_back(detect_features(view));
      pairs = neighbouring_views(features);
      tracked = track_points(features, pairs, Threads());
      for (const TrackedPoint& point : tracked) positions.push_back(point.position);
    }
    std::vector<GapPoint> fill(double spacing) const {
      return fill_gaps(features, positions, pairs, spacing, 0, Threads());
    }
    std::vector<ViewFeatures> features;
    std::vector<std::pair<std::size_t, std::size_t>> pairs;
    std::vector<TrackedPoint> tracked;
    std::vector<glm::dvec3> positions;  ///< of `tracked`
  };

  /// This quantile of the distances of points to the surface, up to the distances between its points, about 0.02.
  static float distance_to_surface(const std::vector<glm::vec3>& points, double quantile) {
    std::vector<float> distances;
    for (const glm::vec3& point : points) {
      float least = std::numeric_limits<float>::infinity();
      for (std::size_t k = 0; k < surface->size(); ++k) least = std::min(least, glm::length(point - at(*surface, k)));
      distances.push_back(least);
    }
    std::ranges::sort(distances);
    return distances[static_cast<std::size_t>(quantile * static_cast<double>(distances.size()))];
  }

  static glm::vec3 at(const PointCloud& points, std::size_t i) {
    return {points.positions[3 * i], points.positions[3 * i + 1], points.positions[3 * i + 2]};
  }

  static std::unique_ptr<TemporaryFolder> folder;
  static std::unique_ptr<std::vector<View>> views;
  static std::unique_ptr<PointCloud> surface;
};

std::unique_ptr<TemporaryFolder> TriangulatedPoints::folder;
std::unique_ptr<std::vector<View>> TriangulatedPoints::views;
std::unique_ptr<PointCloud> TriangulatedPoints::surface;

TEST_F(TriangulatedPoints, LieOnSurfacesAndHaveTheirColours) {
  const Matched matched(*views);
  std::vector<glm::vec3> tracked, gaps, between;
  for (const glm::dvec3& position : matched.positions) tracked.push_back(glm::vec3(position));
  for (const GapPoint& point : matched.fill(kSpacing)) gaps.push_back(glm::vec3(point.position));
  // Points of a dataset: exact, and everywhere.
  std::vector<glm::dvec3> some;
  for (std::size_t k = 0; k < surface->size(); k += 100) some.emplace_back(at(*surface, k));
  for (const GapPoint& point : fill_gaps(matched.features, some, matched.pairs, kSpacing, 0, Threads())) {
    between.push_back(glm::vec3(point.position));
  }
  ASSERT_GT(tracked.size(), 200u);
  EXPECT_GT(gaps.size(), 400u);
  EXPECT_GT(between.size(), 400u);
  // In metres; the room is 8 m wide, and pixels are 2 to 5 cm there. Gaps of tracked points are where there is little
  // texture.
  EXPECT_LT(distance_to_surface(tracked, 0.95), 0.1);
  EXPECT_LT(distance_to_surface(between, 0.5), 0.08);
  EXPECT_LT(distance_to_surface(between, 0.8), 0.25);
  EXPECT_LT(distance_to_surface(gaps, 0.5), 0.12);
  EXPECT_LT(distance_to_surface(gaps, 0.8), 0.45);

  const PointCloud points = triangulate_points(scene_of(*views), Threads());
  ASSERT_EQ(points.colors.size(), points.positions.size());
  std::size_t alike = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    int difference = 255;  // of the view whose pixel is most like the point
    for (const View& view : *views) {
      const Camera& camera = view.camera;
      const glm::vec4 p = camera.camera_from_world * glm::vec4(at(points, i), 1);
      const float x = camera.fx * p.x / p.z + camera.cx, y = camera.fy * p.y / p.z + camera.cy;
      if (!(p.z > 0 && x > 0 && y > 0 && x < static_cast<float>(camera.width) && y < static_cast<float>(camera.height)))
        continue;
      int worst = 0;
      for (int c = 0; c < 3; ++c) {
        const int pixel = (c * camera.height + static_cast<int>(y)) * camera.width + static_cast<int>(x);
        worst = std::max(worst, std::abs(points.colors[3 * i + static_cast<std::size_t>(c)] -
                                         view.color[static_cast<std::size_t>(pixel)]));
      }
      difference = std::min(difference, worst);
    }
    alike += difference < 40 ? 1 : 0;
  }
  EXPECT_GT(alike, points.size() * 95 / 100);
}

/// What a build without OpenCV adds.
class PointsWithoutFeatures : public TriangulatedPoints {
 protected:
  void SetUp() override {}
};

TEST_F(PointsWithoutFeatures, LieOnSurfacesToo) {
  std::vector<ViewFeatures> grey;
  for (const View& view : *views) grey.push_back(grey_view(view));
  std::vector<glm::dvec3> some;
  for (std::size_t k = 0; k < surface->size(); k += 100) some.emplace_back(at(*surface, k));
  std::vector<glm::vec3> gaps;
  for (const GapPoint& point : fill_gaps(grey, some, neighbouring_views(grey), kSpacing, 0, Threads())) {
    gaps.push_back(glm::vec3(point.position));
  }
  ASSERT_GT(gaps.size(), 400u);
  EXPECT_LT(distance_to_surface(gaps, 0.5), 0.08);
  EXPECT_LT(distance_to_surface(gaps, 0.8), 0.25);
}

/// Two views of a wall at a depth of 4. In the masked left part of the second one, something that moved shows what
/// would be seen at a depth of 2.
TEST(PointsInGaps, AreNotAtTheDepthsOfMaskedPixels) {
  constexpr int kWidth = 64, kHeight = 48, kAtFour = 12, kAtTwo = 24;  // displacements, px
  View view;
  view.camera.width = kWidth;
  view.camera.height = kHeight;
  view.camera.fx = view.camera.fy = 96;
  view.camera.cx = 32;
  view.camera.cy = 24;
  ViewFeatures first = reduced_camera(view, kWidth, kHeight, 1, 1), second = first;
  second.centre.x = 0.5;
  const auto texture = [](int x, int y) { return 20 + (x * 7919 + y * 104729 + x * y * 31) % 200; };
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const bool masked = x < 20;
      first.grey.push_back(static_cast<std::uint8_t>(texture(x, y)));
      const double seen = masked ? texture(x + kAtTwo, y) : 0.85 * texture(x + kAtFour, y);  // another exposure
      second.grey.push_back(static_cast<std::uint8_t>(seen));
      second.valid.push_back(masked ? 0 : 1);
    }
  }
  std::vector<glm::dvec3> known;
  for (int y = 2; y < kHeight; y += 2) known.push_back(first.at_depth({36.5, y + 0.5}, y % 4 == 0 ? 4 : 2));
  std::size_t count = 0;
  for (const GapPoint& point : fill_gaps({first, second}, known, {{0, 1}}, 0.03, 0, Threads())) {
    if (point.view != 0 || point.pixel.x < 38 || point.pixel.x > 41 || point.pixel.y < 4 || point.pixel.y > 44)
      continue;
    EXPECT_NEAR(point.position.z, 4, 0.2) << point.pixel.x << ", " << point.pixel.y;
    ++count;
  }
  EXPECT_GT(count, 10u);
}

TEST(GreyView, ReducesLargePhotosByAWholeNumber) {
  View view;
  view.camera.width = 1290;  // 3 × 430
  view.camera.height = 650;  // two rows are left over
  view.camera.fx = view.camera.fy = 900;
  view.camera.cx = 700;
  view.camera.cy = 300;
  view.camera.camera_from_world[3] = glm::vec4(0.1f, -0.2f, 4, 1);
  const std::size_t width = 1290, plane = width * 650;
  view.color.resize(3 * plane);
  view.valid.assign(plane, 0);
  for (std::size_t i = 0; i < plane; ++i) {
    const std::size_t x = i % width, y = i / width;
    view.color[i] = view.color[plane + i] = view.color[2 * plane + i] = static_cast<std::uint8_t>(x / 6 + x % 3);
    view.valid[i] = y < 300 ? 1 : 0;
  }
  const ViewFeatures grey = grey_view(view);
  ASSERT_EQ(grey.width, 430);
  ASSERT_EQ(grey.height, 216);
  ASSERT_EQ(grey.grey.size(), 430u * 216);
  ASSERT_EQ(grey.valid.size(), grey.grey.size());
  for (std::size_t x = 0; x < 430; ++x) {
    EXPECT_EQ(grey.grey[215 * 430 + x], x / 2 + 1);
    EXPECT_EQ(grey.valid[99 * 430 + x], 1);
    EXPECT_EQ(grey.valid[100 * 430 + x], 0);
  }
  const glm::dvec3 point(0.3, 0.4, 1);
  const glm::dvec2 pixel = grey.project(grey.to_camera(point));
  EXPECT_NEAR(3 * pixel.x, 900 * (0.3 + 0.1) / 5 + 700, 1e-4);
  EXPECT_NEAR(3 * pixel.y, 900 * (0.4 - 0.2) / 5 + 300, 1e-4);
  EXPECT_TRUE(grey.pixels.empty());
}

TEST(GreyView, WeighsColoursAndKeepsSmallAndNarrowPhotos) {
  View view;
  view.camera.width = 2;
  view.camera.height = 2000;
  view.color.assign(3 * 4000, 0);
  std::fill_n(view.color.begin() + 4000, 4000, 200);  // green
  const ViewFeatures narrow = grey_view(view);
  EXPECT_EQ(narrow.width, 1);
  EXPECT_EQ(narrow.height, 1000);
  EXPECT_EQ(narrow.grey[250], 117);
  EXPECT_TRUE(narrow.valid.empty());
  view.camera.height = 640;
  view.color.assign(3 * 1280, 255);
  const ViewFeatures same = grey_view(view);
  EXPECT_EQ(same.width, 2);
  EXPECT_EQ(same.height, 640);
  EXPECT_EQ(same.grey, std::vector<std::uint8_t>(1280, 255)) << "white stays white, as backgrounds are";
}

TEST_F(TriangulatedPoints, LeaveNoGapInAnyView) {
  const Matched matched(*views);
  const std::vector<GapPoint> gaps = matched.fill(kSpacing);
  /// Share of the pixels of a grid within whose spacing no point is seen, in all views.
  const auto share = [&](const std::vector<glm::dvec3>& points) {
    std::size_t empty = 0, all = 0;
    for (const ViewFeatures& view : matched.features) {
      const double spacing = kSpacing * view.diagonal();
      std::vector<glm::dvec2> seen;
      for (const glm::dvec3& point : points) {
        const glm::dvec3 p = view.to_camera(point);
        if (p.z > 0) seen.push_back(view.project(p));
      }
      for (double y = spacing / 2; y < view.height; y += spacing) {
        for (double x = spacing / 2; x < view.width; x += spacing) {
          ++all;
          empty += std::ranges::none_of(seen, [&](const glm::dvec2& pixel) {
            return glm::length(pixel - glm::dvec2(x, y)) < spacing * (1 + 1e-9);
          });
        }
      }
    }
    return static_cast<double>(empty) / static_cast<double>(all);
  };
  EXPECT_GT(share(matched.positions), 0.3);
  std::vector<glm::dvec3> filled = matched.positions;
  for (const GapPoint& point : gaps) filled.push_back(point.position);
  EXPECT_LT(share(filled), 0.05) << "only pixels far from all points are left, and those where no depth fits";
  const std::vector<GapPoint> backdrop = backdrop_points(matched.features, filled, kSpacing, 0, Threads());
  EXPECT_LT(backdrop.size(), gaps.size() / 5);
  for (const GapPoint& point : backdrop) filled.push_back(point.position);
  EXPECT_LT(share(filled), 0.001) << "black pixels, which renders show by themselves";
  EXPECT_EQ(fill_gaps(matched.features, filled, matched.pairs, kSpacing, 0, Threads()).size(), 0u);
  EXPECT_EQ(backdrop_points(matched.features, filled, kSpacing, 0, Threads()).size(), 0u);
}

// Too few to be told from random ones, but nobody draws so few.
TEST_F(TriangulatedPoints, AreAddedToAFewOfADataset) {
  Scene scene = scene_of(*views);
  for (std::size_t k = 0; k < 20; ++k) {
    const glm::vec3 p = at(*surface, 100 * k);
    scene.points.positions.insert(scene.points.positions.end(), {p.x, p.y, p.z});
    scene.points.colors.insert(scene.points.colors.end(), 3, 128);
  }
  ASSERT_TRUE(may_add_points(scene));
  const PointCloud alone = triangulate_points(scene_of(*views), Threads());
  EXPECT_GT(triangulate_points(scene, Threads()).size(), alone.size() * 9 / 10) << "as many as if there were none";
  scene.lacks_points = true;
  EXPECT_FALSE(may_add_points(scene)) << "these were triangulated";
  scene.lacks_points = false;
  scene.train.front().time = 0.5f;
  EXPECT_FALSE(may_add_points(scene)) << "it moves";
  scene.train.front().time = 0;
  scene.points = random_points(synthetic_box(), 1000, 1);
  EXPECT_FALSE(may_add_points(scene)) << "they are random";
}

TEST_F(TriangulatedPoints, LieBehindTheSceneWhereNoPointIsNear) {
  // Points at one place of the room only, and too few views to spread from there.
  Scene scene = scene_of({views->begin(), views->begin() + 4});
  for (std::size_t k = 0; k < surface->size() && scene.points.size() < 300; ++k) {
    const glm::vec3 p = at(*surface, k);
    if (glm::length(p) > 0.8f) continue;
    scene.points.positions.insert(scene.points.positions.end(), {p.x, p.y, p.z});
    scene.points.colors.insert(scene.points.colors.end(), 3, 128);
  }
  ASSERT_EQ(scene.points.size(), 300u);
  const PointCloud all = triangulate_points(scene, Threads()), surfaces = triangulate_surfaces(scene, Threads());
  ASSERT_GT(all.size(), surfaces.size() + 100);
  EXPECT_TRUE(std::equal(surfaces.positions.begin(), surfaces.positions.end(), all.positions.begin()));
  float nearest = std::numeric_limits<float>::infinity();
  for (std::size_t i = surfaces.size(); i < all.size(); ++i) nearest = std::min(nearest, glm::length(at(all, i)));
  EXPECT_GT(nearest, 6) << "the room is 8 m wide";
}

TEST_F(TriangulatedPoints, AreOnlyAddedWhereADatasetHasNone) {
  Scene scene = scene_of(*views);
  PointCloud& known = scene.points;  // half of the room
  for (std::size_t k = 0; k < surface->size(); ++k) {
    const glm::vec3 p = at(*surface, k);
    if (p.x > 0) continue;
    known.positions.insert(known.positions.end(), {p.x, p.y, p.z});
    known.colors.insert(known.colors.end(), 3, 128);
  }
  const Matched matched(*views);
  const PointCloud added = triangulate_points(scene, Threads());
  ASSERT_GT(added.size(), matched.tracked.size()) << "features that were triangulated, and points in gaps";
  std::size_t there = 0;
  for (std::size_t k = matched.tracked.size(); k < added.size(); ++k) there += at(added, k).x < -0.5f;
  EXPECT_LT(there, (added.size() - matched.tracked.size()) / 20);

  const PointCloud features = triangulate_features(scene, Threads());
  ASSERT_EQ(features.size(), matched.tracked.size());
  EXPECT_TRUE(std::equal(features.positions.begin(), features.positions.end(), added.positions.begin()));
  EXPECT_TRUE(std::equal(features.colors.begin(), features.colors.end(), added.colors.begin()));
}

TEST_F(TriangulatedPoints, AreTheSameForAnyNumberOfThreads) {
  const PointCloud one = triangulate_points(scene_of(*views), Threads(1)),
                   three = triangulate_points(scene_of(*views), Threads(3));
  EXPECT_EQ(one.positions, three.positions);
  EXPECT_EQ(one.colors, three.colors);
}

TEST_F(TriangulatedPoints, AvoidMaskedPixels) {
  std::vector<View> masked = *views;
  for (View& view : masked) {
    const auto width = static_cast<std::size_t>(view.camera.width),
               height = static_cast<std::size_t>(view.camera.height);
    view.valid.assign(width * height, 0);
    for (std::size_t y = 0; y < height; ++y) std::fill_n(view.valid.begin() + y * width, width / 2, 1);
  }
  const Matched matched(masked);
  ASSERT_GT(matched.tracked.size(), 20u);
  for (const TrackedPoint& point : matched.tracked) {
    for (const auto& [view, number] : point.features) EXPECT_LT(matched.features[view].pixels[number].x, 80);
  }
  const auto gaps = matched.fill(kSpacing);
  ASSERT_GT(gaps.size(), 200u);
  for (const GapPoint& point : gaps) EXPECT_LT(point.pixel.x, 80);
}

TEST_F(TriangulatedPoints, AreNotAddedWherePhotosLookLikeTheBackground) {
  /// In the left halves of the pictures.
  const auto left_of = [&](std::uint8_t shade, std::uint8_t background) {
    std::vector<View> halves = *views;
    for (View& view : halves) {
      const auto width = static_cast<std::size_t>(view.camera.width);
      for (std::size_t i = 0; i < view.color.size(); ++i) {
        if (i % width < width / 2) view.color[i] = shade;
      }
    }
    const Matched matched(halves);
    std::vector<glm::dvec3> everywhere;
    for (std::size_t k = 0; k < surface->size(); k += 100) everywhere.emplace_back(at(*surface, k));
    const auto gaps = fill_gaps(matched.features, everywhere, matched.pairs, kSpacing, background, Threads());
    return std::ranges::count_if(gaps, [](const GapPoint& point) { return point.pixel.x < 80; });
  };
  EXPECT_EQ(left_of(0, 0), 0);
  EXPECT_EQ(left_of(6, 0), 0);
  EXPECT_EQ(left_of(250, 255), 0);
  EXPECT_GT(left_of(20, 0), 50) << "a dark wall";
  EXPECT_GT(left_of(230, 255), 50) << "a light wall";
  EXPECT_GT(left_of(250, 0), 50) << "a white table";
}

TEST_F(TriangulatedPoints, AvoidWhatRendersShowWithoutGaussians) {
  constexpr std::uint8_t kWhite = 255;
  Scene scene = scene_of(*views);
  scene.white_background = true;
  for (std::size_t k = 0; k < surface->size(); k += 50) {
    const glm::vec3 p = at(*surface, k);
    if (p.x < 0) scene.points.positions.insert(scene.points.positions.end(), {p.x, p.y, p.z});
  }
  scene.points.colors.assign(scene.points.positions.size(), 128);
  for (View& view : scene.train) {
    const auto width = static_cast<std::size_t>(view.camera.width);
    for (std::size_t i = 0; i < view.color.size(); ++i) {
      // Stripes: none is white all around a pixel.
      if (i % width < width / 2 && i % width % 8 < 4) view.color[i] = kWhite;
    }
  }
  /// Of the points in gaps, which follow the features.
  const std::size_t tracked = Matched(scene.train).tracked.size();
  const auto white = [&](const PointCloud& points) {
    std::size_t count = 0;
    for (std::size_t i = tracked; i < points.size(); ++i) {
      count += std::ranges::all_of(std::span(points.colors).subspan(3 * i, 3), [&](auto c) { return c == kWhite; });
    }
    return count;
  };
  scene.white_background = false;
  EXPECT_GT(white(triangulate_points(scene, Threads())), 20u) << "renders do not show them by themselves";
  scene.white_background = true;
  const PointCloud added = triangulate_points(scene, Threads());
  EXPECT_GT(added.size(), tracked + 100);
  EXPECT_EQ(white(added), 0u);
}

TEST_F(TriangulatedPoints, NeedViewsFromThreePlaces) {
  EXPECT_EQ(triangulate_points(scene_of({}), Threads()).size(), 0u);
  // Twelve moments of two cameras of a rig: twelve times the same two rays.
  std::vector<View> rig;
  for (int moment = 0; moment < 12; ++moment) {
    rig.push_back(views->at(0));
    rig.push_back(views->at(1));
  }
  EXPECT_EQ(triangulate_points(scene_of(rig), Threads()).size(), 0u);
  // A camera that turns at one place.
  std::vector<View> panorama = *views;
  for (View& view : panorama) view.camera.camera_from_world[3] = glm::vec4(0, 0, 0, 1);
  EXPECT_EQ(triangulate_points(scene_of(panorama), Threads()).size(), 0u);
}

TEST_F(TriangulatedPoints, AreNotMadeOfWrongPoses) {
  std::vector<View> shuffled = *views;
  for (std::size_t i = 0; i < shuffled.size(); ++i) shuffled[i].camera = views->at((i + 12) % views->size()).camera;
  EXPECT_LT(triangulate_points(scene_of(shuffled), Threads()).size(), 10u);
}

TEST_F(TriangulatedPoints, AreWhereTrainingStartsIfADatasetHasNone) {
  SceneOptions options;
  options.source = folder->path() / "room";
  std::filesystem::rename(options.source / "sparse/0/points3D.bin", folder->path() / "points3D.bin");
  const Scene scene = read_scene(options);
  std::filesystem::rename(folder->path() / "points3D.bin", options.source / "sparse/0/points3D.bin");
  EXPECT_EQ(scene.points.positions, triangulate_surfaces(scene_of(*views), Threads()).positions);
  ASSERT_FALSE(scene.notes.empty());
  expect_contains(scene.notes.back(), "the dataset has no points; " + std::to_string(scene.points.size()) +
                                          " were triangulated from its photos");
}

TEST_F(TriangulatedPoints, OfFewViewsAreTooFewToStartFrom) {
  SceneOptions options;
  options.source = folder->path() / "room";
  options.n_views = 3;
  options.random_points = 500;
  std::filesystem::rename(options.source / "sparse/0/points3D.bin", folder->path() / "points3D.bin");
  const Scene scene = read_scene(options);
  std::filesystem::rename(folder->path() / "points3D.bin", options.source / "sparse/0/points3D.bin");
  EXPECT_EQ(scene.points.size(), 500u);
  ASSERT_FALSE(scene.notes.empty());
  expect_contains(scene.notes.back(), "too few could be triangulated from its photos; 500 random ones are used");
}

TEST(NearestToLines, IsWhereTheyMeet) {
  NearestToLines lines;
  EXPECT_EQ(lines.condition(), 0);
  const glm::dvec3 point(1, -2, 3);
  const glm::dvec3 directions[] = {glm::dvec3(1, 0, 0), glm::dvec3(0, 0.6, 0.8)};
  lines.add(point + 5.0 * directions[0], directions[0]);
  EXPECT_NEAR(lines.condition(), 0, 1e-12);
  lines.add(point - 2.0 * directions[1], directions[1], 3);
  EXPECT_GT(lines.condition(), 0.01);
  EXPECT_NEAR(glm::length(lines.point() - point), 0, 1e-12);
}

TEST(NearestToLines, IsNearerToTheHeavierOfTwoLines) {
  NearestToLines lines;
  lines.add({0, 0, 0}, {1, 0, 0});
  lines.add({0, 0, 1}, {0, 1, 0}, 3);
  EXPECT_NEAR(glm::length(lines.point() - glm::dvec3(0, 0, 0.75)), 0, 1e-12);
}

}  // namespace
}  // namespace splatboost::test
