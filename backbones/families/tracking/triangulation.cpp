// SPDX-License-Identifier: Apache-2.0
#include "families/tracking/triangulation.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include <opencv2/calib3d.hpp>

namespace splatboost::tracking {
namespace {

constexpr double kMinParallax = std::numbers::pi / 180;  ///< radians between the two rays to a point
constexpr std::size_t kMinPoints = 50;                   ///< triangulated points of the first two views
constexpr double kMinShare = 0.5;                        ///< of the matches that must be triangulated
/// Median distance of the matches from a common rotation, px. A rotation resembles a translation in a small image, so
/// small residuals of the essential matrix do not exclude it.
constexpr double kMinShift = 3;
constexpr int kRotationRounds = 8;
constexpr double kRansacPixels = 1;
constexpr int kIterations = 15;
constexpr std::size_t kNeighbours = 10;
constexpr int kConnected = 15;         ///< minimum number of shared points of a neighbour
constexpr double kMinBaseline = 0.01;  ///< × median depth
constexpr int kLevelsApart = 2;        ///< maximum difference of the pyramid levels expected and found
constexpr double kFuseRadius = 3;      ///< px

Eigen::Matrix<double, 3, 4> projection_of(const Optics& o, const Pose& pose) {
  Eigen::Matrix3d camera;
  camera << o.fx, 0, o.cx, 0, o.fy, o.cy, 0, 0, 1;
  Eigen::Matrix<double, 3, 4> motion;
  motion << pose.rotation.toRotationMatrix(), pose.translation;
  return camera * motion;
}

cv::Mat to_cv(const Eigen::Matrix<double, 3, 4>& m) {
  cv::Mat result(3, 4, CV_64F);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) result.at<double>(row, column) = m(row, column);
  }
  return result;
}

std::vector<cv::Point2d> pixels_of(std::span<const Sighting> sightings) {
  std::vector<cv::Point2d> pixels;
  pixels.reserve(sightings.size());
  for (const Sighting& s : sightings) pixels.emplace_back(s.pixel.x(), s.pixel.y());
  return pixels;
}

/// Distances, px, of the matches from the rotation that fits the matches `kept` best.
std::vector<double> shifts_besides_rotation(const Optics& optics, std::span<const Sighting> in_first,
                                            std::span<const Sighting> in_second, std::span<const std::size_t> kept) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  const auto ray = [&](const Sighting& s) { return optics.unproject(s.pixel, 1).normalized(); };
  for (const std::size_t i : kept) sum += ray(in_second[i]) * ray(in_first[i]).transpose();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d reflect = Eigen::Matrix3d::Identity();
  reflect(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant();
  const Eigen::Matrix3d rotation = svd.matrixU() * reflect * svd.matrixV().transpose();
  std::vector<double> shifts;
  for (std::size_t i = 0; i < in_first.size(); ++i) {
    const Vec3 turned = rotation * ray(in_first[i]);
    shifts.push_back(turned.z() > 0 ? (optics.project(turned) - in_second[i].pixel).norm() : optics.width);
  }
  return shifts;
}

/// Median distance, px, of the matches from a rotation that fits half of them; the others may be wrong.
double shift_besides_rotation(const Optics& optics, std::span<const Sighting> in_first,
                              std::span<const Sighting> in_second) {
  std::vector<std::size_t> kept(in_first.size());
  std::iota(kept.begin(), kept.end(), std::size_t{0});
  double median = 0;
  for (int round = 0; round < kRotationRounds; ++round) {
    const std::vector<double> shifts = shifts_besides_rotation(optics, in_first, in_second, kept);
    kept.resize(in_first.size());
    std::iota(kept.begin(), kept.end(), std::size_t{0});
    std::ranges::stable_sort(kept, {}, [&](std::size_t i) { return shifts[i]; });
    kept.resize(kept.size() / 2);
    median = shifts[kept.back()];
  }
  return median;
}

/// Maps a pixel of the first camera to its epipolar line a x + b y + c = 0 in the second.
Eigen::Matrix3d fundamental_matrix(const Optics& o, const Pose& first, const Pose& second) {
  const Pose motion = second * first.inverse();
  const Vec3& t = motion.translation;
  Eigen::Matrix3d cross, to_ray;
  cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  to_ray << 1 / o.fx, 0, -o.cx / o.fx, 0, 1 / o.fy, -o.cy / o.fy, 0, 0, 1;
  return to_ray.transpose() * cross * motion.rotation.toRotationMatrix() * to_ray;
}

std::vector<std::uint8_t> unmapped_features(const MapKeyframe& keyframe) {
  std::vector<std::uint8_t> unmapped;
  for (const int p : keyframe.points) unmapped.push_back(p < 0);
  return unmapped;
}

/// Adds sightings of new points in another keyframe. A point that it has already is merged with the new one.
void fuse(SparseMap& map, const std::vector<int>& added, std::size_t keyframe) {
  std::vector<int> candidates = added, visible;
  std::erase_if(candidates, [&](int p) { return map.point(p).gone || map.point(p).sightings.contains(keyframe); });
  const MapKeyframe& other = map.keyframes()[keyframe];
  const std::vector<Expected> expected = expected_in(map, other.pose, candidates, kFuseRadius, visible);
  const std::vector<int> found = match_expected(expected, other.features, FeatureGrid(other.features));
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (found[i] < 0) continue;
    const auto feature = static_cast<std::size_t>(found[i]);
    const Sighting s = map.sighting(keyframe, feature);
    if (squared_error(map.optics(), other.pose, map.point(visible[i]).position, s) > likely_error(s)) continue;
    if (const int known = other.points[feature]; known >= 0) {
      map.merge(visible[i], known);
    } else {
      map.add_sighting(visible[i], keyframe, feature);
    }
  }
}

}  // namespace

std::vector<std::optional<Vec3>> triangulate(const Optics& optics, const Pose& first, const Pose& second,
                                             std::span<const Sighting> in_first, std::span<const Sighting> in_second) {
  std::vector<std::optional<Vec3>> points(in_first.size());
  if (points.empty()) return points;
  cv::Mat homogeneous;
  cv::triangulatePoints(to_cv(projection_of(optics, first)), to_cv(projection_of(optics, second)), pixels_of(in_first),
                        pixels_of(in_second), homogeneous);
  homogeneous.convertTo(homogeneous, CV_64F);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const cv::Mat p = homogeneous.col(static_cast<int>(i));
    const Vec3 point = Vec3(p.at<double>(0), p.at<double>(1), p.at<double>(2)) / p.at<double>(3);
    if (!point.allFinite()) continue;
    const Vec3 a = point - first.centre(), b = point - second.centre();
    if (a.dot(b) > std::cos(kMinParallax) * a.norm() * b.norm()) continue;
    if (squared_error(optics, first, point, in_first[i]) > likely_error(in_first[i])) continue;
    if (squared_error(optics, second, point, in_second[i]) > likely_error(in_second[i])) continue;
    points[i] = point;
  }
  return points;
}

std::optional<TwoViews> relate_views(const Optics& optics, std::span<const Sighting> in_first,
                                     std::span<const Sighting> in_second) {
  if (in_first.size() < kMinPoints || shift_besides_rotation(optics, in_first, in_second) < kMinShift) return {};
  const std::vector<cv::Point2d> from = pixels_of(in_first), to = pixels_of(in_second);
  const cv::Matx33d camera(optics.fx, 0, optics.cx, 0, optics.fy, optics.cy, 0, 0, 1);
  cv::Mat turn, move;
  try {
    cv::Mat fits;
    const cv::Mat essential = cv::findEssentialMat(from, to, camera, cv::RANSAC, 0.999, kRansacPixels, fits);
    if (essential.rows != 3 || essential.cols != 3) return {};
    cv::recoverPose(essential, from, to, camera, turn, move, fits);
  } catch (const cv::Exception&) {  // degenerate matches
    return {};
  }
  TwoViews views;
  Eigen::Matrix3d rotation;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) rotation(row, column) = turn.at<double>(row, column);
    views.second.translation[row] = move.at<double>(row);
  }
  views.second.rotation = Eigen::Quaterniond(rotation).normalized();

  // Refine pose and points together, then look again at which of the matches fit.
  const auto enough = [&] {
    const auto count = std::ranges::count_if(views.points, [](const auto& p) { return p.has_value(); });
    return static_cast<std::size_t>(count) >= kMinPoints &&
           static_cast<double>(count) >= kMinShare * static_cast<double>(in_first.size());
  };
  views.points = triangulate(optics, {}, views.second, in_first, in_second);
  if (!enough()) return {};
  Bundle bundle;
  bundle.poses = {{}, views.second};
  bundle.fixed = {1, 0};
  for (std::size_t i = 0; i < views.points.size(); ++i) {
    if (!views.points[i]) continue;
    for (const std::size_t camera_index : {std::size_t{0}, std::size_t{1}}) {
      bundle.sightings.push_back(camera_index == 0 ? in_first[i] : in_second[i]);
      bundle.sightings.back().camera = camera_index;
      bundle.sightings.back().point = bundle.points.size();
    }
    bundle.points.push_back(*views.points[i]);
  }
  adjust(optics, bundle, kIterations);
  views.second = bundle.poses[1];
  views.points = triangulate(optics, {}, views.second, in_first, in_second);
  if (!enough()) return {};
  std::vector<double> depths;
  for (const auto& point : views.points) {
    if (point) depths.push_back(point->z());
  }
  const double unit = median_of(std::move(depths));
  for (auto& point : views.points) {
    if (point) *point /= unit;
  }
  views.second.translation /= unit;
  return views;
}

std::vector<int> add_triangulated_points(SparseMap& map, std::size_t keyframe) {
  const Vec3 centre = map.keyframes()[keyframe].pose.centre();
  const auto baseline = [&](std::size_t other) { return (map.keyframes()[other].pose.centre() - centre).norm(); };
  std::vector<std::size_t> neighbours;
  for (const auto& [other, shared] : map.covisible(keyframe)) {
    if (neighbours.size() == kNeighbours || shared < kConnected) break;
    neighbours.push_back(other);
  }
  // A long baseline gives the most accurate points, so it comes first.
  std::ranges::stable_sort(neighbours, std::ranges::greater{}, baseline);
  std::vector<int> added;
  for (const std::size_t other : neighbours) {
    const MapKeyframe &now = map.keyframes()[keyframe], &then = map.keyframes()[other];
    if (baseline(other) < kMinBaseline * now.median_depth) break;
    const std::vector<int> matches =
        match_along_lines(now.features, then.features, fundamental_matrix(map.optics(), now.pose, then.pose),
                          unmapped_features(now), unmapped_features(then));
    std::vector<std::size_t> of;
    std::vector<Sighting> in_now, in_then;
    for (std::size_t f = 0; f < matches.size(); ++f) {
      if (matches[f] < 0) continue;
      of.push_back(f);
      in_now.push_back(map.sighting(keyframe, f));
      in_then.push_back(map.sighting(other, static_cast<std::size_t>(matches[f])));
    }
    const auto points = triangulate(map.optics(), now.pose, then.pose, in_now, in_then);
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (!points[i]) continue;
      const std::size_t f = of[i];
      const auto other_feature = static_cast<std::size_t>(matches[f]);
      const double distance = (now.pose * *points[i]).norm();
      const double steps = std::log(distance / (then.pose * *points[i]).norm()) / std::log(kLevelFactor);
      const double level = now.features.levels[f] + steps;
      if (std::abs(level - then.features.levels[other_feature]) > kLevelsApart) continue;
      added.push_back(map.add_point(*points[i], distance, keyframe, f));
      map.add_sighting(added.back(), other, other_feature);
    }
  }
  for (const std::size_t other : neighbours) fuse(map, added, other);
  return added;
}

}  // namespace splatboost::tracking
