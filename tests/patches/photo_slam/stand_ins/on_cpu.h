// SPDX-License-Identifier: Apache-2.0
/// @file Included before each of Photo-SLAM's files, to run its CUDA calls on the CPU.
#pragma once

#include <torch/torch.h>
#include <opencv2/opencv.hpp>
#include <random>

namespace cv::cuda {

/// An image in host memory.
struct HostMat : cv::Mat {
  using cv::Mat::Mat;
  HostMat(const cv::Mat& mat) : cv::Mat(mat) {}
  void upload(const cv::Mat& mat) { mat.copyTo(*this); }
  void download(cv::Mat& mat) const { copyTo(mat); }
};

}  // namespace cv::cuda

namespace std {

/// Returns the same number in every run, so that two builds can be compared.
struct fixed_random_device {
  using result_type = unsigned;
  static constexpr result_type min() { return 0; }
  static constexpr result_type max() { return ~0u; }
  result_type operator()() { return 20240612; }
};

}  // namespace std

#define GpuMat HostMat
#define random_device fixed_random_device
#define kCUDA kCPU
// Calls on tensors and in torch::cuda; function-like macros, so that the namespaces named cuda are not replaced.
#define cuda() cpu()
#define synchronize() is_available()
// zero_grad() of libtorch before 2.0 has no argument.
#define zero_grad(...) zero_grad()
