// SPDX-License-Identifier: Apache-2.0
// Poses and points from observations, against known ground truth.
#include "families/tracking/adjustment.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "splatboost/random.h"

namespace splatboost::tracking {
namespace {

const Optics kOptics{320, 240, 250, 260, 159.5, 119.5};

Pose moved(const Pose& pose, const Vec3& axis_angle, const Vec3& shift) {
  const double angle = axis_angle.norm();
  const Pose motion{Eigen::Quaterniond(Eigen::AngleAxisd(angle, angle > 0 ? Vec3(axis_angle / angle) : Vec3(1, 0, 0))),
                    shift};
  return motion * pose;
}

std::vector<Vec3> cloud(std::size_t count) {
  const RandomStream random(5, 0, RandomPurpose::synth);
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < count; ++i) {
    points.emplace_back(3 * random.uniform(3 * i) - 1.5, 2 * random.uniform(3 * i + 1) - 1,
                        2 + 2 * random.uniform(3 * i + 2));
  }
  return points;
}

Sighting seen(const Pose& pose, const std::vector<Vec3>& points, std::size_t point, bool depth) {
  const Vec3 p = pose * points[point];
  Sighting s;
  s.point = point;
  s.pixel = kOptics.project(p);
  s.depth = depth ? p.z() : 0;
  return s;
}

TEST(Pose, composes_and_inverts) {
  const Pose a = moved({}, {0.1, 0.2, -0.3}, {1, 2, 3}), b = moved({}, {-0.5, 0.1, 0.4}, {0.3, -1, 2});
  const Vec3 p(0.3, -0.7, 2);
  EXPECT_LT(((a * b) * p - a * (b * p)).norm(), 1e-12);
  EXPECT_LT((a.inverse() * (a * p) - p).norm(), 1e-12);
  EXPECT_LT((a * a.centre()).norm(), 1e-12);
}

TEST(Pose, unprojects_what_it_projects) {
  const Vec3 p(0.4, -0.3, 2.5);
  EXPECT_LT((kOptics.unproject(kOptics.project(p), 2.5) - p).norm(), 1e-12);
}

class RefinePose : public ::testing::TestWithParam<bool> {};

TEST_P(RefinePose, finds_the_pose_and_the_wrong_sightings) {
  const std::vector<Vec3> points = cloud(60);
  const Pose truth = moved({}, {0.05, -0.1, 0.02}, {0.1, 0.05, -0.2});
  std::vector<Sighting> sightings;
  for (std::size_t i = 0; i < points.size(); ++i) {
    sightings.push_back(seen(truth, points, i, GetParam()));
    if (i % 4 == 0) sightings.back().pixel += Vec2(40, -25);
  }
  Pose pose = moved(truth, {0.02, 0.03, -0.01}, {0.05, -0.03, 0.04});
  std::vector<std::uint8_t> fits;
  EXPECT_EQ(refine_pose(kOptics, points, sightings, pose, fits), 45u);
  for (std::size_t i = 0; i < fits.size(); ++i) EXPECT_EQ(fits[i], i % 4 != 0) << i;
  EXPECT_LT((pose.centre() - truth.centre()).norm(), 1e-6);
  EXPECT_LT(angle_between(pose, truth), 1e-6);
}
INSTANTIATE_TEST_SUITE_P(Depth, RefinePose, ::testing::Bool());

TEST(RefinePose, too_few_sightings_are_none) {
  const std::vector<Vec3> points = cloud(3);
  std::vector<Sighting> sightings;
  for (std::size_t i = 0; i < 3; ++i) sightings.push_back(seen({}, points, i, true));
  Pose pose;
  std::vector<std::uint8_t> fits;
  EXPECT_EQ(refine_pose(kOptics, points, sightings, pose, fits), 0u);
}

TEST(Bundle, poses_and_points_come_back) {
  const std::vector<Vec3> truth = cloud(80);
  Bundle bundle;
  std::vector<Pose> poses;
  for (int i = 0; i < 4; ++i) poses.push_back(moved({}, {0, 0.05 * i, 0.01 * i}, {0.1 * i, 0, 0.02 * i}));
  const RandomStream random(6, 0, RandomPurpose::synth);
  for (std::size_t i = 0; i < truth.size(); ++i) {
    bundle.points.push_back(truth[i] +
                            0.03 * Vec3(random.normal(3 * i), random.normal(3 * i + 1), random.normal(3 * i + 2)));
    for (std::size_t c = 0; c < poses.size(); ++c) {
      bundle.sightings.push_back(seen(poses[c], truth, i, c < 3));
      bundle.sightings.back().camera = c;
    }
  }
  for (std::size_t c = 0; c < poses.size(); ++c) {
    bundle.fixed.push_back(c == 0);
    bundle.poses.push_back(c == 0 ? poses[0] : moved(poses[c], {0.01, -0.02, 0.01}, {0.02, 0.01, -0.03}));
  }
  adjust(kOptics, bundle, 20);
  EXPECT_LT((bundle.poses[0].centre() - poses[0].centre()).norm(), 1e-12);
  for (std::size_t c = 0; c < poses.size(); ++c) {
    EXPECT_LT((bundle.poses[c].centre() - poses[c].centre()).norm(), 1e-4) << c;
  }
  for (std::size_t i = 0; i < truth.size(); ++i) EXPECT_LT((bundle.points[i] - truth[i]).norm(), 1e-3) << i;
}

/// A ring of poses whose steps all have the same error in rotation and translation; the loop edge gives the total.
TEST(PoseGraph, a_loop_spreads_what_it_is_off) {
  constexpr int kCount = 20;
  std::vector<Pose> truth, drifted;
  for (int i = 0; i <= kCount; ++i) {
    const double angle = 2 * std::numbers::pi * i / kCount;
    truth.push_back(moved({Eigen::Quaterniond::Identity(), Vec3(-2 * std::cos(angle), -2 * std::sin(angle), 0)},
                          {0, 0, angle}, {0, 0, 0}));
  }
  std::vector<Edge> edges;
  drifted.push_back(truth[0]);
  for (std::size_t i = 1; i < truth.size(); ++i) {
    const Pose step = moved(truth[i] * truth[i - 1].inverse(), {0, 0, 0.004}, {0.005, 0, 0});
    drifted.push_back(step * drifted.back());
    edges.push_back({i - 1, i, step});
  }
  const double before = (drifted.back().centre() - truth.back().centre()).norm();
  ASSERT_GT(before, 0.1);
  edges.push_back({0, truth.size() - 1, truth.back() * truth[0].inverse(), 20});
  relax_pose_graph(drifted, edges);
  EXPECT_LT((drifted[0].centre() - truth[0].centre()).norm(), 1e-12);
  EXPECT_LT((drifted.back().centre() - truth.back().centre()).norm(), 0.01 * before);
  for (std::size_t i = 0; i < truth.size(); ++i) {
    EXPECT_LT((drifted[i].centre() - truth[i].centre()).norm(), 0.5 * before) << i;
  }
}

/// The same ring, seen by a camera whose unit of length shrinks at each step.
TEST(PoseGraph, a_loop_spreads_the_drift_of_the_scale) {
  constexpr int kCount = 20;
  constexpr double kShrink = 0.98;
  std::vector<Pose> truth, drifted;
  for (int i = 0; i <= kCount; ++i) {
    const double angle = 2 * std::numbers::pi * i / kCount;
    truth.push_back(moved({Eigen::Quaterniond::Identity(), Vec3(-2 * std::cos(angle), -2 * std::sin(angle), 0)},
                          {0, 0, angle}, {0, 0, 0}));
  }
  std::vector<Edge> edges;
  drifted.push_back(truth[0]);
  double unit = 1;
  for (std::size_t i = 1; i < truth.size(); ++i) {
    Pose step = truth[i] * truth[i - 1].inverse();
    unit *= kShrink;
    step.translation *= unit;
    drifted.push_back(step * drifted.back());
    edges.push_back({i - 1, i, step});
  }
  const double before = (drifted.back().centre() - truth.back().centre()).norm();
  ASSERT_GT(before, 0.5);
  // The last pose is the first one again, in another unit.
  edges.push_back({0, truth.size() - 1, truth.back() * truth[0].inverse(), 20, unit});
  std::vector<double> scales;
  relax_pose_graph(drifted, edges, &scales);
  ASSERT_EQ(scales.size(), truth.size());
  EXPECT_EQ(scales[0], 1);
  EXPECT_NEAR(scales.back(), 1 / unit, 0.01);
  EXPECT_LT((drifted.back().centre() - truth.back().centre()).norm(), 0.01 * before);
  for (std::size_t i = 0; i < truth.size(); ++i) {
    EXPECT_LT((drifted[i].centre() - truth[i].centre()).norm(), 0.4 * before) << i;
  }
}

}  // namespace
}  // namespace splatboost::tracking
