// SPDX-License-Identifier: Apache-2.0
/// @file What Photo-SLAM uses of OpenCV's module of this name, on the CPU.
#pragma once

#include "on_cpu.h"

namespace cv::cuda {

inline void cvtColor(const HostMat& from, HostMat& to, int code) { cv::cvtColor(from, to, code); }

}  // namespace cv::cuda
