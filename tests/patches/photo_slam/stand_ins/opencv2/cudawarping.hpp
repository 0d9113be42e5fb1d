// SPDX-License-Identifier: Apache-2.0
/// @file The parts of OpenCV's module of this name that Photo-SLAM uses, on the CPU. Include after on_cpu.h.
#pragma once

namespace cv::cuda {

inline void resize(const HostMat& from, HostMat& to, cv::Size size) { cv::resize(from, to, size); }

}  // namespace cv::cuda
