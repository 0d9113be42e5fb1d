// SPDX-License-Identifier: Apache-2.0
// Poses and points from two views without depth, against known ground truth.
#include "families/tracking/triangulation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "splatboost/random.h"

namespace splatboost::tracking {
namespace {

const Optics kOptics{320, 240, 250, 260, 159.5, 119.5};

Pose pose_of(const Vec3& axis_angle, const Vec3& centre) {
  const double angle = axis_angle.norm();
  const Eigen::Quaterniond rotation(Eigen::AngleAxisd(angle, angle > 0 ? Vec3(axis_angle / angle) : Vec3::UnitX()));
  return {rotation, -(rotation * centre)};
}

/// Points that both cameras see, and their sightings with noise of half a pixel; every fifth match is wrong.
struct Matches {
  explicit Matches(const Pose& pose, std::size_t wrong_every = 5) {
    const RandomStream random(7, 0, RandomPurpose::synth);
    for (std::uint64_t i = 0; points.size() < 150; ++i) {
      const Vec3 p(6 * random.uniform(8 * i) - 3, 4 * random.uniform(8 * i + 1) - 2, 2 + 4 * random.uniform(8 * i + 2));
      const Vec3 q = pose * p;
      if (q.z() < 0.5 || !kOptics.contains(kOptics.project(p)) || !kOptics.contains(kOptics.project(q))) continue;
      Sighting a, b;
      a.pixel = kOptics.project(p) + 0.5 * Vec2(random.normal(8 * i + 3), random.normal(8 * i + 4));
      b.pixel = kOptics.project(q) + 0.5 * Vec2(random.normal(8 * i + 5), random.normal(8 * i + 6));
      if (points.size() % wrong_every == 0) b.pixel += Vec2(30, 25);
      points.push_back(p);
      first.push_back(a);
      second.push_back(b);
    }
  }
  std::vector<Vec3> points;
  std::vector<Sighting> first, second;
};

TEST(TwoViews, give_the_pose_and_the_points_up_to_scale) {
  const Pose truth = pose_of({0.02, -0.05, 0.01}, {0.5, 0.1, 0.1});
  const Matches matches(truth);
  const std::optional<TwoViews> views = relate_views(kOptics, matches.first, matches.second);
  ASSERT_TRUE(views.has_value());
  EXPECT_LT(angle_between(views->second, truth), 0.01);
  EXPECT_GT(views->second.centre().normalized().dot(truth.centre().normalized()), std::cos(0.05));
  const double scale = truth.centre().norm() / views->second.centre().norm();
  std::vector<double> depths, errors;
  for (std::size_t i = 0; i < matches.points.size(); ++i) {
    if (i % 5 == 0) {
      EXPECT_FALSE(views->points[i].has_value()) << i;
    } else if (views->points[i]) {
      depths.push_back(views->points[i]->z());
      errors.push_back((scale * *views->points[i] - matches.points[i]).norm() / matches.points[i].z());
    }
  }
  EXPECT_GT(depths.size(), 100u);
  std::ranges::sort(depths);
  std::ranges::sort(errors);
  EXPECT_EQ(depths[depths.size() / 2], 1);
  EXPECT_LT(errors[errors.size() / 2], 0.05);
}

TEST(TwoViews, a_rotation_does_not_relate_them) {
  for (const double angle : {0.0, 0.03, 0.1, 0.3}) {
    const Matches matches(pose_of({0, angle, 0.2 * angle}, {0, 0, 0}), 3);
    EXPECT_FALSE(relate_views(kOptics, matches.first, matches.second).has_value()) << angle;
  }
}

TEST(TwoViews, too_small_a_motion_does_not_relate_them) {
  const Matches matches(pose_of({0, 0.02, 0}, {0.02, 0, 0}), 1000);
  EXPECT_FALSE(relate_views(kOptics, matches.first, matches.second).has_value());
}

TEST(TwoViews, wrong_matches_do_not_relate_them) {
  Matches matches(pose_of({0, 0, 0}, {0.5, 0, 0}));
  std::ranges::reverse(matches.second);
  EXPECT_FALSE(relate_views(kOptics, matches.first, matches.second).has_value());
  EXPECT_FALSE(relate_views(kOptics, {}, {}).has_value());
}

TEST(Triangulation, leaves_out_points_without_parallax_or_behind_a_camera) {
  const Pose second = pose_of({0, 0, 0}, {0.2, 0, 0});
  const std::vector<Vec3> points{{0.3, 0.1, 3}, {0.3, 0.1, 60}, {0.1, 0, -2}};
  std::vector<Sighting> in_first, in_second;
  for (const Vec3& p : points) {
    in_first.emplace_back().pixel = kOptics.project(p);
    in_second.emplace_back().pixel = kOptics.project(second * p);
  }
  in_first.push_back(in_first[0]);
  in_second.push_back(in_second[0]);
  in_second.back().pixel.y() += 10;  // off its epipolar line
  const auto found = triangulate(kOptics, {}, second, in_first, in_second);
  ASSERT_TRUE(found[0].has_value());
  EXPECT_LT((*found[0] - points[0]).norm(), 1e-6);
  for (std::size_t i = 1; i < found.size(); ++i) EXPECT_FALSE(found[i].has_value()) << i;
}

/// Three keyframes: two of them share points, and all of them see features that are no points yet.
TEST(Triangulation, a_keyframe_gets_new_points_which_others_see_too) {
  const RandomStream random(8, 0, RandomPurpose::synth);
  SparseMap map(kOptics, false);
  std::vector<Vec3> world;
  cv::Mat descriptors(200, 32, CV_8U);
  for (std::uint64_t i = 0; i < 200; ++i) {
    world.emplace_back(2 * random.uniform(4 * i) - 1, 1.4 * random.uniform(4 * i + 1) - 0.7,
                       2.5 + random.uniform(4 * i + 2));
    for (int byte = 0; byte < 32; ++byte) {
      descriptors.at<std::uint8_t>(static_cast<int>(i), byte) =
          static_cast<std::uint8_t>(random.bits(100000 + 32 * i + static_cast<std::size_t>(byte)));
    }
  }
  for (int k = 0; k < 3; ++k) {
    MapKeyframe keyframe;
    keyframe.pose = pose_of({0, 0, 0}, {0.15 * k, 0, 0});
    keyframe.median_depth = 3;
    for (const Vec3& p : world) {
      keyframe.features.pixels.push_back(kOptics.project(keyframe.pose * p));
      keyframe.features.depths.push_back(0);
      keyframe.features.levels.push_back(0);
      keyframe.features.strengths.push_back(1);
    }
    keyframe.features.descriptors = descriptors;
    keyframe.points.assign(world.size(), -1);
    keyframe.colors.assign(world.size(), {});
    map.keyframes().push_back(keyframe);
  }
  for (std::size_t i = 0; i < 40; ++i) {
    const int point = map.add_point(world[i], world[i].norm(), 0, i);
    for (std::size_t k = 1; k < 3; ++k) map.add_sighting(point, k, i);
  }
  const std::vector<int> added = add_triangulated_points(map, 2);
  EXPECT_GT(added.size(), 150u);
  for (const int number : added) {
    const MapPoint& p = map.point(number);
    EXPECT_EQ(p.keyframe, 2u);
    EXPECT_EQ(p.sightings.size(), 3u);
    EXPECT_LT((p.position - world[p.sightings.at(2)]).norm(), 1e-3);
    EXPECT_EQ(p.sightings.at(0), p.sightings.at(2));
  }
  EXPECT_TRUE(add_triangulated_points(map, 2).empty());
}

}  // namespace
}  // namespace splatboost::tracking
