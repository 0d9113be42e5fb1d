// SPDX-License-Identifier: Apache-2.0
/// @file The parts of OpenCV's module of this name that Photo-SLAM uses, on the CPU. Include after on_cpu.h.
#pragma once

namespace cv::cuda {

inline void cvtColor(const HostMat& from, HostMat& to, int code) { cv::cvtColor(from, to, code); }

}  // namespace cv::cuda
