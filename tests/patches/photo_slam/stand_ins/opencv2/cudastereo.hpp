// SPDX-License-Identifier: Apache-2.0
/// @file The parts of OpenCV's module of this name that Photo-SLAM uses. Include after on_cpu.h; stereo is never run.
#pragma once

namespace cv::cuda {

struct StereoSGM {
  void compute(const HostMat&, const HostMat&, HostMat&) { throw std::logic_error("no stereo on the CPU"); }
  int getMinDisparity() const { return 0; }
  int getNumDisparities() const { return 0; }
};

inline cv::Ptr<StereoSGM> createStereoSGM(int, int) { return cv::makePtr<StereoSGM>(); }
inline void reprojectImageTo3D(const HostMat&, HostMat&, const cv::Mat&, int) {
  throw std::logic_error("no stereo on the CPU");
}

}  // namespace cv::cuda
