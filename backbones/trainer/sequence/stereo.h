// SPDX-License-Identifier: Apache-2.0
/// @file Depth from two cameras side by side: rectified by their calibration, matched semi-globally (OpenCV's
/// StereoSGBM, after Hirschmüller 2008).
#pragma once

#include <memory>
#include <string>

#include <glm/mat4x4.hpp>

#include "trainer/sequence/sequence.h"

namespace splatboost {

/// Two cameras side by side; right_from_left is in metres.
struct StereoRig {
  Calibration left, right;
  glm::dmat4 right_from_left{1.0};
  std::string source = {};  ///< file that it was read from, for messages
};

/// A rig after rectification: corresponding points lie on the same row of both images.
class StereoDepth {
 public:
  /// Throws InputError if the cameras are not side by side, and in a build without OpenCV.
  explicit StereoDepth(const StereoRig& rig);
  ~StereoDepth();

  /// Of the rectified left camera, without distortion. Its depth_scale is 1: depth() returns metres.
  const Calibration& calibration() const;
  glm::dmat4 left_from_rectified() const;
  /// Rectifies in place. @param rgb [H,W,3] @param valid set to [H,W], 255 where there is data, else 0
  void rectify_left(std::vector<std::uint8_t>& rgb, std::vector<std::uint8_t>& valid) const;
  /// @param left [H,W,3] rectified @param right [H,W,3] not rectified @return [H,W] metres along z, 0: not known
  std::vector<float> depth(const std::vector<std::uint8_t>& left, std::vector<std::uint8_t> right) const;

 private:
  struct Rectified;
  std::unique_ptr<Rectified> rectified_;
};

}  // namespace splatboost
