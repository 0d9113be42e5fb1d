// SPDX-License-Identifier: Apache-2.0
/// @file ORB features of images, and matching between two images or between an image and map points.
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

inline constexpr double kLevelFactor = 1.2;  ///< scale factor between levels of the ORB pyramid
inline constexpr int kLevels = 8;

struct Features {
  std::vector<Vec2> pixels;
  std::vector<double> depths;    ///< metres; 0: unknown
  std::vector<int> levels;       ///< pyramid level
  std::vector<float> strengths;  ///< detector response
  cv::Mat descriptors;           ///< [N,32] bytes
  std::size_t size() const { return pixels.size(); }
};

class FeatureExtractor {
 public:
  /// @param count maximum number of features per image, spread over the image
  explicit FeatureExtractor(int count);
  /// @param color [H,W,3] RGB @param depth [H,W] metres, or empty @param valid [H,W] zero: no features there; or empty
  Features extract(int width, int height, std::span<const std::uint8_t> color, std::span<const float> depth,
                   std::span<const std::uint8_t> valid) const;

 private:
  int count_;
  cv::Ptr<cv::ORB> detector_, describer_;
};

/// Spatial index of the features of an image. The features must outlive it.
class FeatureGrid {
 public:
  explicit FeatureGrid(const Features& features);
  ~FeatureGrid();
  /// Indices of the features nearer than `radius` pixels, ascending.
  void within(const Vec2& place, double radius, std::vector<std::size_t>& found) const;

 private:
  struct Tree;
  std::unique_ptr<Tree> tree_;
};

/// A map point to search for in an image.
struct Expected {
  Vec2 place = Vec2::Zero();
  double radius = 0;   ///< px
  int level = 0;       ///< approximate pyramid level
  cv::Mat descriptor;  ///< [1,32]
};

/// For each expected point the index of the best feature if it is close and unambiguous, else -1. A feature is matched
/// at most once.
std::vector<int> match_expected(std::span<const Expected> expected, const Features& features, const FeatureGrid& grid);

/// Mutual nearest neighbours that pass a ratio test: for each descriptor of `a` the index of its match in `b`, or -1.
std::vector<int> match_descriptors(const cv::Mat& a, const cv::Mat& b);

/// Matches features of two images with known poses. @param line_of maps a pixel of `a` to its epipolar line in `b`
/// @param usable_a, usable_b [features] zero: not matched
/// @return for each feature of `a` the index of its match in `b`, or -1
std::vector<int> match_along_lines(const Features& a, const Features& b, const Eigen::Matrix3d& line_of,
                                   std::span<const std::uint8_t> usable_a, std::span<const std::uint8_t> usable_b);

}  // namespace splatboost::tracking
