// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>

#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "trainer/features/view_features.h"

namespace splatboost {
namespace {

constexpr int kShortestSide = 16;  ///< px; SIFT needs some pixels
constexpr int kFeatures = 4000;    ///< per view, at most
constexpr int kOctaveLayers = 3;
constexpr double kContrast = 0.01;
constexpr double kEdge = 20;  ///< limit of the responses along edges

/// Square roots of descriptors that sum to 1, which have length 1.
std::vector<std::uint8_t> root_descriptors(const cv::Mat& descriptors) {
  std::vector<std::uint8_t> roots;
  for (int row = 0; row < descriptors.rows; ++row) {
    const auto* entries = descriptors.ptr<float>(row);
    float sum = 0;
    for (std::size_t k = 0; k < kDescriptorSize; ++k) sum += entries[k];
    for (std::size_t k = 0; k < kDescriptorSize; ++k) {
      roots.push_back(
          cv::saturate_cast<std::uint8_t>(sum > 0 ? kDescriptorLength * std::sqrt(entries[k] / sum) : 0.0f));
    }
  }
  return roots;
}

/// A matrix that shares these pixels, which are not changed.
cv::Mat plane_of(const std::uint8_t* pixels, const Camera& camera) {
  return {camera.height, camera.width, CV_8U, const_cast<std::uint8_t*>(pixels)};
}

std::vector<std::uint8_t> bytes_of(const cv::Mat& plane) { return {plane.datastart, plane.dataend}; }

}  // namespace

ViewFeatures detect_features(const View& view) {
  const Camera& camera = view.camera;
  const std::size_t plane = view.color.size() / 3;
  const std::array<cv::Mat, 3> planes{plane_of(view.color.data(), camera), plane_of(view.color.data() + plane, camera),
                                      plane_of(view.color.data() + 2 * plane, camera)};
  cv::Mat color, grey, mask;
  cv::merge(planes, color);
  cv::cvtColor(color, grey, cv::COLOR_RGB2GRAY);
  if (!view.valid.empty()) mask = plane_of(view.valid.data(), camera) != 0;
  if (const int longest = std::max(camera.width, camera.height); longest > kLongestSide) {
    const double scale = static_cast<double>(kLongestSide) / longest;
    const cv::Size size(std::max(1, cvRound(camera.width * scale)), std::max(1, cvRound(camera.height * scale)));
    cv::resize(grey, grey, size, 0, 0, cv::INTER_AREA);
    if (!mask.empty()) cv::resize(mask, mask, size, 0, 0, cv::INTER_NEAREST);
  }
  ViewFeatures features = reduced_camera(view, grey.cols, grey.rows, static_cast<double>(grey.cols) / camera.width,
                                         static_cast<double>(grey.rows) / camera.height);
  features.grey = bytes_of(grey);
  features.valid = bytes_of(mask);
  if (std::min(grey.cols, grey.rows) < kShortestSide) return features;

  std::vector<cv::KeyPoint> found;
  cv::Mat descriptors;
  cv::SIFT::create(kFeatures, kOctaveLayers, kContrast, kEdge)->detectAndCompute(grey, mask, found, descriptors);
  for (const cv::KeyPoint& point : found) {
    features.pixels.emplace_back(static_cast<double>(point.pt.x) + 0.5, static_cast<double>(point.pt.y) + 0.5);
  }
  features.descriptors = root_descriptors(descriptors);
  return features;
}

}  // namespace splatboost
