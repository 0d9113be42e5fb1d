// SPDX-License-Identifier: Apache-2.0
#include "families/tracking/features.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <utility>

#include <nanoflann.hpp>
#include <opencv2/core/hal/hal.hpp>
#include <opencv2/imgproc.hpp>

namespace splatboost::tracking {
namespace {

constexpr int kSurplus = 3;         ///< ratio of detected to kept features
constexpr int kCellSide = 32;       ///< px; the strongest features of each cell are kept first
constexpr int kFastThreshold = 10;  ///< grey levels
constexpr int kMaxBits = 60;        ///< maximum Hamming distance (of 256 bits) between descriptors of one point
constexpr int kFarBits = 80;        ///< the same for matches near an expected position
constexpr double kClearly = 0.8;    ///< ratio test: best / second best distance, upper bound
constexpr double kLineErrors = 2;   ///< distance from the epipolar line, standard deviations
constexpr int kLevelsApart = 2;     ///< maximum difference of pyramid levels
constexpr int kBorder = 19;         ///< px without features at each side of a level: half of a rotated patch
constexpr float kEdge = 0.05f;      ///< relative depth difference of neighbouring pixels at an edge

int bits_apart(const std::uint8_t* a, const std::uint8_t* b) {
  return static_cast<int>(cv::hal::normHamming(a, b, 32));
}

/// The depth at a pixel; 0 at depth edges, where it may belong to either side.
double depth_at(std::span<const float> depth, int width, int height, int x, int y) {
  const auto at = [&](int column, int row) {
    return depth[static_cast<std::size_t>(row) * static_cast<std::size_t>(width) + static_cast<std::size_t>(column)];
  };
  const float z = at(x, y);
  for (int row = std::max(0, y - 1); row <= std::min(height - 1, y + 1); ++row) {
    for (int column = std::max(0, x - 1); column <= std::min(width - 1, x + 1); ++column) {
      const float beside = at(column, row);
      if (beside > 0 && std::abs(beside - z) > kEdge * z) return 0;
    }
  }
  return static_cast<double>(z);
}

}  // namespace

FeatureExtractor::FeatureExtractor(int count)
    : count_(count),
      detector_(cv::ORB::create(kSurplus * count, static_cast<float>(kLevelFactor), kLevels, kBorder, 0, 2,
                                cv::ORB::FAST_SCORE, 31, kFastThreshold)),
      describer_(detector_) {}

Features FeatureExtractor::extract(int width, int height, std::span<const std::uint8_t> color,
                                   std::span<const float> depth, std::span<const std::uint8_t> valid) const {
  const cv::Mat rgb(height, width, CV_8UC3, const_cast<std::uint8_t*>(color.data()));
  cv::Mat grey;
  cv::cvtColor(rgb, grey, cv::COLOR_RGB2GRAY);
  std::vector<cv::KeyPoint> found;
  detector_->detect(grey, found);
  if (!valid.empty()) {
    std::erase_if(found, [&](const cv::KeyPoint& k) {
      return valid[static_cast<std::size_t>(std::lround(k.pt.y)) * static_cast<std::size_t>(width) +
                   static_cast<std::size_t>(std::lround(k.pt.x))] == 0;
    });
  }
  // In rounds: each takes the strongest remaining feature of every cell.
  std::ranges::sort(found, [](const cv::KeyPoint& a, const cv::KeyPoint& b) {
    return std::make_tuple(-a.response, a.octave, a.pt.y, a.pt.x) <
           std::make_tuple(-b.response, b.octave, b.pt.y, b.pt.x);
  });
  std::map<std::pair<int, int>, int> in_cell;
  std::vector<std::pair<int, std::size_t>> rounds;
  for (std::size_t i = 0; i < found.size(); ++i) {
    const std::pair<int, int> cell(static_cast<int>(found[i].pt.x) / kCellSide,
                                   static_cast<int>(found[i].pt.y) / kCellSide);
    rounds.emplace_back(in_cell[cell]++, i);
  }
  std::ranges::sort(rounds);
  rounds.resize(std::min(rounds.size(), static_cast<std::size_t>(count_)));
  std::vector<cv::KeyPoint> kept;
  for (const auto& [round, i] : rounds) {
    kept.push_back(found[i]);
    kept.back().class_id = static_cast<int>(kept.size());
  }
  // OpenCV reorders keypoints by level; restore the order, because similar_keyframes() compares the first ones only.
  cv::Mat descriptors;
  if (!kept.empty()) describer_->compute(grey, kept, descriptors);
  std::vector<std::size_t> order(kept.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::sort(order, {}, [&](std::size_t i) { return kept[i].class_id; });
  Features features;
  features.descriptors = cv::Mat(0, 32, CV_8U);
  for (const std::size_t i : order) features.descriptors.push_back(descriptors.row(static_cast<int>(i)));
  for (const std::size_t i : order) {
    const cv::KeyPoint& k = kept[i];
    // OpenCV scales the column and row of a level, whose pixel centres are not where that puts them.
    const double shift = 0.5 * (std::pow(kLevelFactor, k.octave) - 1);
    const Vec2 pixel(static_cast<double>(k.pt.x) + shift, static_cast<double>(k.pt.y) + shift);
    features.pixels.push_back(pixel);
    features.levels.push_back(k.octave);
    features.strengths.push_back(k.response);
    const auto x = static_cast<int>(std::lround(pixel.x())), y = static_cast<int>(std::lround(pixel.y()));
    features.depths.push_back(depth.empty() ? 0.0 : depth_at(depth, width, height, x, y));
  }
  return features;
}

struct FeatureGrid::Tree {
  const std::vector<Vec2>& pixels;

  std::size_t kdtree_get_point_count() const { return pixels.size(); }
  double kdtree_get_pt(std::size_t i, std::size_t axis) const { return pixels[i][static_cast<Eigen::Index>(axis)]; }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }

  using Index = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Tree>, Tree, 2, std::uint32_t>;
  Index index{2, *this};
};

FeatureGrid::FeatureGrid(const Features& features) : tree_(new Tree{features.pixels}) {}
FeatureGrid::~FeatureGrid() = default;

namespace {

/// Result set of the tree's search.
struct Within {
  using DistanceType = double;
  double most;
  std::vector<std::size_t>& found;
  std::size_t size() const { return found.size(); }
  bool empty() const { return found.empty(); }
  bool full() const { return true; }
  bool addPoint(double squared, std::uint32_t i) {
    if (squared < most) found.push_back(i);
    return true;
  }
  double worstDist() const { return most; }
  void sort() {}
};

}  // namespace

void FeatureGrid::within(const Vec2& place, double radius, std::vector<std::size_t>& found) const {
  found.clear();
  if (tree_->pixels.empty()) return;
  Within result{radius * radius, found};
  tree_->index.findNeighbors(result, place.data(), {});
  std::ranges::sort(found);
}

std::vector<int> match_expected(std::span<const Expected> expected, const Features& features, const FeatureGrid& grid) {
  std::vector<int> matches(expected.size(), -1), owner(features.size(), -1), distance_of(features.size(), 0);
  std::vector<std::size_t> near;
  for (std::size_t e = 0; e < expected.size(); ++e) {
    const Expected& wanted = expected[e];
    grid.within(wanted.place, wanted.radius, near);
    int best = kFarBits + 1, second = 257, at = -1, best_level = 0, second_level = -1;
    for (const std::size_t i : near) {
      if (std::abs(features.levels[i] - wanted.level) > kLevelsApart) continue;
      const int distance = bits_apart(wanted.descriptor.ptr<std::uint8_t>(),
                                      features.descriptors.ptr<std::uint8_t>(static_cast<int>(i)));
      if (distance < best) {
        second = best;  // at first the limit, which a lone candidate must be clearly below too
        second_level = best_level;
        best = distance;
        best_level = features.levels[i];
        at = static_cast<int>(i);
      } else if (distance < second) {
        second = distance;
        second_level = features.levels[i];
      }
    }
    if (at < 0 || (best_level == second_level && best >= kClearly * second)) continue;
    // Assign a feature to the point with the nearest descriptor only.
    const auto slot = static_cast<std::size_t>(at);
    if (owner[slot] >= 0) {
      if (distance_of[slot] <= best) continue;
      matches[static_cast<std::size_t>(owner[slot])] = -1;
    }
    owner[slot] = static_cast<int>(e);
    distance_of[slot] = best;
    matches[e] = at;
  }
  return matches;
}

std::vector<int> match_descriptors(const cv::Mat& a, const cv::Mat& b) {
  std::vector<int> matches(static_cast<std::size_t>(a.rows), -1);
  if (a.rows == 0 || b.rows < 2) return matches;
  const cv::BFMatcher matcher(cv::NORM_HAMMING);
  std::vector<std::vector<cv::DMatch>> forward;
  std::vector<cv::DMatch> backward;
  matcher.knnMatch(a, b, forward, 2);
  matcher.match(b, a, backward);
  for (const std::vector<cv::DMatch>& two : forward) {
    if (two.size() < 2 || two[0].distance > kMaxBits) continue;
    if (two[0].distance >= static_cast<float>(kClearly) * two[1].distance) continue;
    if (backward[static_cast<std::size_t>(two[0].trainIdx)].trainIdx != two[0].queryIdx) continue;
    matches[static_cast<std::size_t>(two[0].queryIdx)] = two[0].trainIdx;
  }
  return matches;
}

std::vector<int> match_along_lines(const Features& a, const Features& b, const Eigen::Matrix3d& line_of,
                                   std::span<const std::uint8_t> usable_a, std::span<const std::uint8_t> usable_b) {
  std::vector<int> matches(a.size(), -1), owner(b.size(), -1), distance_of(b.size(), 0);
  std::vector<double> farthest;  // px from the line, of features of `b`
  farthest.reserve(b.size());
  for (const int level : b.levels) farthest.push_back(kLineErrors * std::pow(kLevelFactor, level));
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (usable_a[i] == 0) continue;
    Vec3 line = line_of * a.pixels[i].homogeneous();
    const double length = line.head<2>().norm();
    if (!(length > 0)) continue;
    line /= length;
    int best = kMaxBits + 1, second = 257, at = -1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      if (usable_b[j] == 0) continue;
      if (std::abs(line.dot(b.pixels[j].homogeneous())) > farthest[j]) continue;
      const int distance = bits_apart(a.descriptors.ptr<std::uint8_t>(static_cast<int>(i)),
                                      b.descriptors.ptr<std::uint8_t>(static_cast<int>(j)));
      if (distance < best) {
        second = best;  // at first the limit, which a lone candidate must be clearly below too
        best = distance;
        at = static_cast<int>(j);
      } else {
        second = std::min(second, distance);
      }
    }
    if (at < 0 || best >= kClearly * second) continue;
    // Two features of `a` that match the same one of `b`: the nearer descriptor is kept.
    const auto slot = static_cast<std::size_t>(at);
    if (owner[slot] >= 0) {
      if (distance_of[slot] <= best) continue;
      matches[static_cast<std::size_t>(owner[slot])] = -1;
    }
    owner[slot] = static_cast<int>(i);
    distance_of[slot] = best;
    matches[i] = at;
  }
  return matches;
}

}  // namespace splatboost::tracking
