// SPDX-License-Identifier: Apache-2.0
/// @file ORB features of a picture, and which of two pictures, or of a picture and points, belong together.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>

#include "families/tracking/pose.h"

namespace splatboost::tracking {

inline constexpr double kLevelFactor = 1.2;  ///< of the sizes of ORB's pyramid
inline constexpr int kLevels = 8;

struct Features {
  std::vector<Vec2> pixels;
  std::vector<double> depths;  ///< 0: not known
  std::vector<int> levels;     ///< of the pyramid
  std::vector<float> strengths;
  cv::Mat descriptors;  ///< [N,32] bytes
  std::size_t size() const { return pixels.size(); }
};

class FeatureExtractor {
 public:
  /// @param count features that are wanted, spread over the picture
  explicit FeatureExtractor(int count);
  /// @param color [H,W,3] RGB @param depth [H,W] metres, or empty @param valid [H,W], or empty: no feature elsewhere
  Features extract(int width, int height, std::span<const std::uint8_t> color, std::span<const float> depth,
                   std::span<const std::uint8_t> valid) const;

 private:
  int count_;
  cv::Ptr<cv::ORB> detector_, describer_;
};

/// Features of a picture by place.
class FeatureGrid {
 public:
  explicit FeatureGrid(const Features& features);
  ~FeatureGrid();
  /// Numbers of the features nearer than `radius`, ascending.
  void within(const Vec2& place, double radius, std::vector<std::size_t>& found) const;

 private:
  struct Tree;
  std::unique_ptr<Tree> tree_;
};

/// What is looked for in a picture.
struct Expected {
  Vec2 place = Vec2::Zero();
  double radius = 0;   ///< px
  int level = 0;       ///< of the pyramid, about
  cv::Mat descriptor;  ///< [1,32]
};

/// For each what fits best and clearly enough, once each; -1: nothing does.
std::vector<int> match_expected(std::span<const Expected> expected, const Features& features, const FeatureGrid& grid);

/// For each descriptor of `a` the number of that of `b` which is clearly nearest and of which it is the nearest too;
/// -1: there is none.
std::vector<int> match_descriptors(const cv::Mat& a, const cv::Mat& b);

}  // namespace splatboost::tracking
