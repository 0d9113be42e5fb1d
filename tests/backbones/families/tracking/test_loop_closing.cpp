// SPDX-License-Identifier: Apache-2.0
// A trajectory around a ring of points, with drift: its end sees the same points as its beginning.
#include "families/tracking/loop_closing.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "splatboost/random.h"

namespace splatboost::tracking {
namespace {

constexpr std::size_t kAround = 24, kKeyframes = 27, kPoints = 3000;
constexpr std::size_t kMemory = 3;  ///< keyframes after which a point that is seen again is mapped as a new one

const Optics kOptics{320, 240, 250, 250, 159.5, 119.5};

/// On a circle of radius 1 within the ring of points, looking outwards.
Pose true_pose(std::size_t keyframe) {
  const double angle = 2 * std::numbers::pi * static_cast<double>(keyframe) / kAround;
  Eigen::Matrix3d camera_from_world;
  camera_from_world << -std::sin(angle), std::cos(angle), 0, 0, 0, -1, std::cos(angle), std::sin(angle), 0;
  camera_from_world.row(0) *= -1;  // x points right, with z up in the world
  const Eigen::Quaterniond rotation(camera_from_world);
  return {rotation, -(rotation * Vec3(std::cos(angle), std::sin(angle), 0))};
}

class Ring : public ::testing::Test {
 protected:
  /// @param shrink factor of the unit of length at each step; a map without depth if it is not 1
  explicit Ring(double shrink = 1) : map_(kOptics, shrink == 1) {
    const RandomStream random(11, 0, RandomPurpose::synth);
    std::vector<Vec3> world;
    cv::Mat descriptors(static_cast<int>(kPoints), 32, CV_8U);
    for (std::size_t i = 0; i < kPoints; ++i) {
      const double angle = 2 * std::numbers::pi * random.uniform(4 * i);
      const double radius = 4 + random.uniform(4 * i + 2);
      world.emplace_back(radius * std::cos(angle), radius * std::sin(angle), 3 * random.uniform(4 * i + 1) - 1.5);
      for (int byte = 0; byte < 32; ++byte) {
        descriptors.at<std::uint8_t>(static_cast<int>(i), byte) =
            static_cast<std::uint8_t>(random.bits(100000 + 32 * i + static_cast<std::size_t>(byte)));
      }
    }
    // Each step adds the same drift.
    const Pose off{Eigen::Quaterniond(Eigen::AngleAxisd(0.003, Vec3(0, 1, 0))), {0.006, 0.002, 0}};
    std::vector<int> number(kPoints, -1);
    std::vector<std::size_t> last(kPoints, 0);
    Pose drift;
    double unit = 1;
    for (std::size_t k = 0; k < kKeyframes; ++k) {
      const Pose truth = true_pose(k);
      MapKeyframe keyframe;
      keyframe.frame = k;
      keyframe.pose = drift * truth;
      // The positions drift with the unit: each step is the true one, in the unit at that time.
      if (k > 0 && shrink != 1) {
        Pose step = truth * true_pose(k - 1).inverse();
        step.translation *= unit;
        keyframe.pose = off * step * map_.keyframes().back().pose;
      }
      keyframe.median_depth = 3.5 * unit;
      std::vector<std::size_t> of;
      for (std::size_t i = 0; i < kPoints; ++i) {
        const Vec3 p = truth * world[i];
        if (p.z() < 0.5 || !kOptics.contains(kOptics.project(p))) continue;
        of.push_back(i);
        keyframe.features.pixels.push_back(kOptics.project(p));
        keyframe.features.depths.push_back(shrink == 1 ? p.z() : 0);
        keyframe.features.levels.push_back(0);
        keyframe.features.strengths.push_back(1);
        keyframe.features.descriptors.push_back(descriptors.row(static_cast<int>(i)));
      }
      keyframe.points.assign(of.size(), -1);
      map_.keyframes().push_back(keyframe);
      for (std::size_t f = 0; f < of.size(); ++f) {
        const std::size_t i = of[f];
        if (number[i] < 0 || last[i] + kMemory < k) {
          MapPoint point;
          const Vec3 seen = unit * (truth * world[i]);
          point.position = keyframe.pose.inverse() * seen;
          point.descriptor = descriptors.row(static_cast<int>(i));
          point.distance = seen.norm();
          point.keyframe = k;
          number[i] = static_cast<int>(map_.points().size());
          map_.points().push_back(point);
        }
        last[i] = k;
        map_.add_sighting(number[i], k, f);
      }
      drift = off * drift;
      unit *= shrink;
    }
  }

  /// Distance of keyframe `k` from its true position, relative to the first keyframe.
  double error(std::size_t k) const {
    const Pose found = map_.keyframes()[k].pose * map_.keyframes()[0].pose.inverse();
    return (found.centre() - (true_pose(k) * true_pose(0).inverse()).centre()).norm();
  }
  std::size_t points() const {
    std::size_t count = 0;
    for (const MapPoint& p : map_.points()) count += p.gone ? 0 : 1;
    return count;
  }

  SparseMap map_;
};

class RingWithoutDepth : public Ring {
 protected:
  static constexpr double kShrink = 0.99;
  RingWithoutDepth() : Ring(kShrink) {}
};

TEST_F(Ring, a_place_is_found_again_and_only_then) {
  EXPECT_FALSE(find_loop(map_, 14).has_value());
  const auto loop = find_loop(map_, kKeyframes - 1);
  ASSERT_TRUE(loop.has_value());
  EXPECT_LT(loop->earlier, 6u);
  const Pose found = loop->pose * map_.keyframes()[loop->earlier].pose.inverse();
  const Pose truth = true_pose(kKeyframes - 1) * true_pose(loop->earlier).inverse();
  EXPECT_LT((found.centre() - truth.centre()).norm(), 0.05);
}

TEST_F(Ring, a_closed_loop_takes_the_drift_out_and_joins_what_was_mapped_twice) {
  const double before = error(kKeyframes - 1);
  const std::size_t points_before = points();
  ASSERT_GT(before, 0.1);
  const auto loop = find_loop(map_, kKeyframes - 1);
  ASSERT_TRUE(loop.has_value());
  close_loop(map_, *loop);
  EXPECT_LT(error(kKeyframes - 1), 0.1 * before);
  for (std::size_t k = 0; k < kKeyframes; ++k) EXPECT_LT(error(k), 0.5 * before) << k;
  EXPECT_LT(points(), points_before - 50);
  // Points and keyframes refer to each other consistently.
  for (std::size_t k = 0; k < kKeyframes; ++k) {
    const MapKeyframe& keyframe = map_.keyframes()[k];
    for (std::size_t f = 0; f < keyframe.points.size(); ++f) {
      if (keyframe.points[f] < 0) continue;
      const MapPoint& p = map_.point(keyframe.points[f]);
      ASSERT_FALSE(p.gone);
      ASSERT_EQ(p.sightings.at(k), f);
    }
  }
  EXPECT_FALSE(find_loop(map_, kKeyframes - 1).has_value());  // already merged into one place
}

TEST_F(RingWithoutDepth, a_closed_loop_takes_the_drift_of_the_scale_out) {
  const double before = error(kKeyframes - 1);
  ASSERT_GT(before, 0.2);
  const auto loop = find_loop(map_, kKeyframes - 1);
  ASSERT_TRUE(loop.has_value());
  const double drift = std::pow(kShrink, static_cast<double>(kKeyframes - 1 - loop->earlier));
  EXPECT_NEAR(loop->scale, 1 / drift, 0.05);
  close_loop(map_, *loop);
  EXPECT_EQ(map_.keyframes()[0].scale, 1);
  EXPECT_GT(map_.keyframes().back().scale, 1.1);
  EXPECT_LT(error(kKeyframes - 1), 0.2 * before);
  for (std::size_t k = 0; k < kKeyframes; ++k) EXPECT_LT(error(k), 0.5 * before) << k;
}

}  // namespace
}  // namespace splatboost::tracking
