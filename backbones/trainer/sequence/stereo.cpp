// SPDX-License-Identifier: Apache-2.0
#include "trainer/sequence/stereo.h"

#include <cmath>
#include <utility>

#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr int kBlock = 5;              ///< px
constexpr int kWidthsOfDisparity = 6;  ///< the largest disparity is the image width divided by this
constexpr double kMinDisparity = 1;    ///< px; depth from smaller ones is mostly noise
constexpr int kSubpixels = 16;         ///< of StereoSGBM's disparities

cv::Matx33d camera_matrix(const Calibration& c) { return {c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1}; }
cv::Vec<double, 5> distortion(const Calibration& c) { return {c.k1, c.k2, c.p1, c.p2, c.k3}; }

cv::Mat grey(std::vector<std::uint8_t>& rgb, cv::Size size) {
  cv::Mat result;
  cv::cvtColor(cv::Mat(size, CV_8UC3, rgb.data()), result, cv::COLOR_RGB2GRAY);
  return result;
}

}  // namespace

struct StereoDepth::Rectified {
  cv::Size size;
  Calibration calibration;
  glm::dmat4 left_from_rectified{1.0};
  double disparity_depth = 0;  ///< px · metres: focal length × baseline
  cv::Mat left_x, left_y, right_x, right_y;
};

StereoDepth::StereoDepth(const StereoRig& rig) : rectified_(std::make_unique<Rectified>()) {
  Rectified& r = *rectified_;
  r.size = {rig.left.width, rig.left.height};
  cv::Matx33d turn, left_turn, right_turn;
  cv::Vec3d shift;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) turn(row, column) = rig.right_from_left[column][row];
    shift[row] = rig.right_from_left[3][row];
  }
  require(std::abs(shift[0]) > 1e-3 && std::abs(shift[0]) > std::abs(shift[1]) && shift[0] < 0,
          (rig.source.empty() ? "" : rig.source + ": ") +
              "the cameras of a stereo pair must be side by side, cam1 to the right of cam0; check T_BS of both");
  cv::Matx34d left_camera, right_camera;
  cv::Matx44d ignored;
  cv::stereoRectify(camera_matrix(rig.left), distortion(rig.left), camera_matrix(rig.right), distortion(rig.right),
                    r.size, turn, shift, left_turn, right_turn, left_camera, right_camera, ignored,
                    cv::CALIB_ZERO_DISPARITY, 0);
  cv::initUndistortRectifyMap(camera_matrix(rig.left), distortion(rig.left), left_turn,
                              left_camera.get_minor<3, 3>(0, 0), r.size, CV_32FC1, r.left_x, r.left_y);
  cv::initUndistortRectifyMap(camera_matrix(rig.right), distortion(rig.right), right_turn,
                              right_camera.get_minor<3, 3>(0, 0), r.size, CV_32FC1, r.right_x, r.right_y);
  Calibration& c = r.calibration;
  c.width = rig.left.width, c.height = rig.left.height;
  c.fx = left_camera(0, 0), c.fy = left_camera(1, 1), c.cx = left_camera(0, 2), c.cy = left_camera(1, 2);
  c.depth_scale = 1;
  r.disparity_depth = -right_camera(0, 3);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) r.left_from_rectified[column][row] = left_turn(column, row);
  }
}
StereoDepth::~StereoDepth() = default;

const Calibration& StereoDepth::calibration() const { return rectified_->calibration; }
glm::dmat4 StereoDepth::left_from_rectified() const { return rectified_->left_from_rectified; }

void StereoDepth::rectify_left(std::vector<std::uint8_t>& rgb, std::vector<std::uint8_t>& valid) const {
  const Rectified& r = *rectified_;
  std::vector<std::uint8_t> result(rgb.size());
  cv::Mat to(r.size, CV_8UC3, result.data());
  cv::remap(cv::Mat(r.size, CV_8UC3, rgb.data()), to, r.left_x, r.left_y, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  rgb = std::move(result);
  valid.resize(rgb.size() / 3);
  for (int y = 0; y < r.size.height; ++y) {
    for (int x = 0; x < r.size.width; ++x) {
      const float u = r.left_x.at<float>(y, x), v = r.left_y.at<float>(y, x);
      const bool inside =
          u >= 0 && v >= 0 && u <= static_cast<float>(r.size.width - 1) && v <= static_cast<float>(r.size.height - 1);
      valid[static_cast<std::size_t>(y) * static_cast<std::size_t>(r.size.width) + static_cast<std::size_t>(x)] =
          inside ? 255 : 0;
    }
  }
}

std::vector<float> StereoDepth::depth(const std::vector<std::uint8_t>& left, std::vector<std::uint8_t> right) const {
  const Rectified& r = *rectified_;
  std::vector<std::uint8_t> left_copy = left;
  const cv::Mat left_grey = grey(left_copy, r.size);
  cv::Mat right_grey, disparity;
  cv::remap(grey(right, r.size), right_grey, r.right_x, r.right_y, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  const int largest = (r.size.width / kWidthsOfDisparity + 15) / 16 * 16;
  // Single pass in one thread: with the parallel modes, disparities depend on the number of threads.
  const auto matcher = cv::StereoSGBM::create(0, largest, kBlock, 8 * kBlock * kBlock, 32 * kBlock * kBlock, 1, 0, 10,
                                              100, 2, cv::StereoSGBM::MODE_SGBM);
  matcher->compute(left_grey, right_grey, disparity);
  std::vector<float> depth(static_cast<std::size_t>(r.size.area()), 0.0f);
  for (int y = 0; y < r.size.height; ++y) {
    for (int x = 0; x < r.size.width; ++x) {
      const double shift = static_cast<double>(disparity.at<std::int16_t>(y, x)) / kSubpixels;
      if (shift < kMinDisparity) continue;
      depth[static_cast<std::size_t>(y) * static_cast<std::size_t>(r.size.width) + static_cast<std::size_t>(x)] =
          static_cast<float>(r.disparity_depth / shift);
    }
  }
  return depth;
}

}  // namespace splatboost
