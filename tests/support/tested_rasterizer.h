// SPDX-License-Identifier: Apache-2.0
/// @file The rasterizer under test. The files of its tests are built twice, so that every device has the same tests:
/// for the CPU, where this is the core's rasterizer, and for CUDA (SPLATBOOST_TEST_ON_CUDA), where it copies inputs to
/// the device and results back.
#pragma once

#include <gtest/gtest.h>

#include <vector>

#include "splatboost/rasterizer.h"

#ifndef SPLATBOOST_TEST_ON_CUDA

namespace splatboost::test {

/// Number of cases to run of a test with many random cases.
constexpr int some_of(int cases) { return cases; }

/// Expects gradients of two backward passes over the same frame to be bitwise equal.
inline void expect_same_gradients(const std::vector<float>& a, const std::vector<float>& b) { EXPECT_EQ(a, b); }

}  // namespace splatboost::test

#else

#include <cmath>
#include <cstdlib>
#include <string_view>

#include "splatboost/cuda_stream.h"
#include "splatboost/device_array.h"
#include "splatboost/errors.h"

namespace splatboost::test {

/// Fewer cases, because the emulator is slow.
constexpr int some_of(int cases) { return cases / 20; }

/// With a tolerance, because a GPU sums over pixels in any order.
inline void expect_same_gradients(const std::vector<float>& a, const std::vector<float>& b) {
  ASSERT_EQ(a.size(), b.size());
  float largest = 0;
  for (const float value : a) largest = std::max(largest, std::abs(value));
  for (std::size_t k = 0; k < a.size(); ++k) EXPECT_NEAR(a[k], b[k], 1e-5f * (largest + std::abs(a[k]))) << k;
}

/// The stream of the tested device. Throws NoDeviceError if there is no device.
inline CudaStream& test_stream() {
  static CudaStream stream;
  return stream;
}

/// Skips all tests if there is no device.
class NeedsDevice : public ::testing::Environment {
  void SetUp() override {
    try {
      test_stream();
    } catch (const NoDeviceError& error) {
      GTEST_SKIP() << error.what();
    }
  }
};
inline ::testing::Environment* const needs_device = ::testing::AddGlobalTestEnvironment(new NeedsDevice);

/// Copies host memory to the device, and back if requested.
template <class T>
class Carried {
 public:
  std::span<const T> there(std::span<const T> host) {
    if (host.empty()) return {};
    array_.upload(host);
    return array_.span();
  }
  /// Also copies the current content to the device, so that elements that are not written there are noticed.
  std::span<T> there_and_back(std::span<T> host) {
    host_ = host;
    if (host.empty()) return {};
    array_.upload(host);
    return array_.span();
  }
  void back() {
    if (!host_.empty()) array_.download(host_);
  }

 private:
  DeviceArray<T> array_{test_stream()};
  std::span<T> host_;
};

class Rasterizer {
 public:
  explicit Rasterizer(const Threads&) : rasterizer_(test_stream()) {}

  void forward(const Camera& camera, const Gaussians& gaussians, const RasterOptions& options,
               const RasterImages& images) {
    gaussians_ = gaussians;
    gaussians_.means = means_.there(gaussians.means);
    gaussians_.scales = scales_.there(gaussians.scales);
    gaussians_.rotations = rotations_.there(gaussians.rotations);
    gaussians_.covariances = covariances_.there(gaussians.covariances);
    gaussians_.opacities = opacities_.there(gaussians.opacities);
    gaussians_.sh_dc = sh_dc_.there(gaussians.sh_dc);
    gaussians_.sh_rest = sh_rest_.there(gaussians.sh_rest);
    gaussians_.colors = colors_.there(gaussians.colors);
    gaussians_.features = features_.there(gaussians.features);
    Carried<float> color, features, inverse_depth, alpha;
    rasterizer_.forward(camera, gaussians_, options,
                        {color.there_and_back(images.color), features.there_and_back(images.features),
                         inverse_depth.there_and_back(images.inverse_depth), alpha.there_and_back(images.alpha)});
    rasterizer_.settle();
    for (Carried<float>* image : {&color, &features, &inverse_depth, &alpha}) image->back();
  }

  void backward(const Gaussians& gaussians, const RasterImageGradients& images, const GaussianGradients& gradients) {
    EXPECT_EQ(gaussians.count, gaussians_.count);
    Carried<float> color, features, inverse_depth, alpha;
    Carried<float> out[11];
    GaussianGradients there;
    there.mode = gradients.mode;
    there.means = out[0].there_and_back(gradients.means);
    there.scales = out[1].there_and_back(gradients.scales);
    there.rotations = out[2].there_and_back(gradients.rotations);
    there.covariances = out[3].there_and_back(gradients.covariances);
    there.opacities = out[4].there_and_back(gradients.opacities);
    there.sh_dc = out[5].there_and_back(gradients.sh_dc);
    there.sh_rest = out[6].there_and_back(gradients.sh_rest);
    there.colors = out[7].there_and_back(gradients.colors);
    there.features = out[8].there_and_back(gradients.features);
    there.screen_means = out[9].there_and_back(gradients.screen_means);
    there.screen_means_abs = out[10].there_and_back(gradients.screen_means_abs);
    rasterizer_.backward(gaussians_,
                         {color.there(images.color), features.there(images.features),
                          inverse_depth.there(images.inverse_depth), alpha.there(images.alpha)},
                         there);
    for (Carried<float>& rows : out) rows.back();
  }

  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) {
    Carried<std::uint8_t> mask;
    Carried<std::int32_t> sums;
    rasterizer_.count_flagged(mask.there(flagged), sums.there_and_back(counts));
    sums.back();
  }

  void count_observed(float min_transmittance, std::span<std::int32_t> counts) {
    Carried<std::int32_t> sums;
    rasterizer_.count_observed(min_transmittance, sums.there_and_back(counts));
    sums.back();
  }

  void add_weights(std::span<std::int32_t> weights) {
    Carried<std::int32_t> sums;
    rasterizer_.add_weights(sums.there_and_back(weights));
    sums.back();
  }

  const std::vector<std::uint8_t>& visible() { return fetch(rasterizer_.visible(), visible_); }
  const std::vector<std::int32_t>& screen_radii() { return fetch(rasterizer_.screen_radii(), radii_); }
  RasterCounts counts() const { return rasterizer_.counts(); }
  const RasterSeconds& seconds() const { return rasterizer_.seconds(); }

 private:
  template <class T>
  const std::vector<T>& fetch(std::span<const T> there, std::vector<T>& host) {
    host.resize(there.size());
    test_stream().copy_to_host(host.data(), there.data(), there.size_bytes());
    return host;
  }

  splatboost::Rasterizer rasterizer_;
  Gaussians gaussians_;
  Carried<float> means_, scales_, rotations_, covariances_, opacities_, sh_dc_, sh_rest_, colors_, features_;
  std::vector<std::uint8_t> visible_;
  std::vector<std::int32_t> radii_;
};

}  // namespace splatboost::test

#endif
