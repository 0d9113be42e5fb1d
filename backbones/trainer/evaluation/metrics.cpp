// SPDX-License-Identifier: Apache-2.0
#include "trainer/evaluation/metrics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace splatboost {
namespace {

constexpr int kRadius = 5;
constexpr int kTaps = 2 * kRadius + 1;
constexpr double kSigma = 1.5;
constexpr double kC1 = 0.01 * 0.01;  // (0.01·L)², L = 1: the stabilizing constants of Wang et al. 2004
constexpr double kC2 = 0.03 * 0.03;
constexpr double kEqual = 100.0;  // what PSNR reports for equal images, instead of infinity

void check_shapes(std::span<const float> render, const TruthImage& truth) {
  const std::size_t pixels = static_cast<std::size_t>(truth.width) * static_cast<std::size_t>(truth.height);
  if (truth.width <= 0 || truth.height <= 0 || render.size() != 3 * pixels || truth.color.size() != 3 * pixels ||
      (!truth.valid.empty() && truth.valid.size() != pixels)) {
    throw std::invalid_argument("image metrics: render and truth must be [3,H,W], and valid [H,W] or empty");
  }
}

double truth_value(std::uint8_t value) { return value / 255.0; }

std::array<double, kTaps> gaussian_window() {
  std::array<double, kTaps> window{};
  double sum = 0;
  for (int i = 0; i < kTaps; ++i) {
    const double d = i - kRadius;
    sum += window[i] = std::exp(-d * d / (2 * kSigma * kSigma));
  }
  for (double& weight : window) weight /= sum;
  return window;
}

// The five window means of SSIM at one pixel, or one row of them.
enum Moment { kRender, kTruth, kRender2, kTruth2, kProduct, kMoments };

// SSIM of one channel, summed over valid pixels. Rows are filtered along x once, kept in a ring of eleven, and summed
// along y when the row in their middle is due, so memory does not grow with the height.
class ChannelSsim {
 public:
  ChannelSsim(int width, int height) : width_(width), height_(height) {
    for (auto& row : padded_) row.assign(width + 2 * kRadius, 0.0);
    for (auto& moments : ring_) {
      for (auto& row : moments) row.assign(width, 0.0);
    }
    for (auto& row : mean_) row.assign(width, 0.0);
  }

  double sum(const float* render, const std::uint8_t* truth, const std::uint8_t* valid) {
    double total = 0;
    for (int y = -kRadius; y < height_; ++y) {
      const int arriving = y + kRadius;
      if (arriving < height_) {
        const std::size_t offset = static_cast<std::size_t>(arriving) * width_;
        filter_row(arriving % kTaps, render + offset, truth + offset, valid ? valid + offset : nullptr);
      }
      if (y >= 0) total += sum_row(y, valid ? valid + static_cast<std::size_t>(y) * width_ : nullptr);
    }
    return total;
  }

 private:
  void filter_row(int slot, const float* render, const std::uint8_t* truth, const std::uint8_t* valid) {
    for (int x = 0; x < width_; ++x) {
      const double t = truth_value(truth[x]);
      const double r = valid && !valid[x] ? t : std::clamp(static_cast<double>(render[x]), 0.0, 1.0);
      const int at = x + kRadius;  // the margins stay zero (padding)
      padded_[kRender][at] = r;
      padded_[kTruth][at] = t;
      padded_[kRender2][at] = r * r;
      padded_[kTruth2][at] = t * t;
      padded_[kProduct][at] = r * t;
    }
    for (int m = 0; m < kMoments; ++m) {
      std::vector<double>& out = ring_[slot][m];
      std::fill(out.begin(), out.end(), 0.0);
      for (int i = 0; i < kTaps; ++i) {
        const double weight = window_[i];
        const double* in = padded_[m].data() + i;
        for (int x = 0; x < width_; ++x) out[x] += weight * in[x];
      }
    }
  }

  double sum_row(int y, const std::uint8_t* valid) {
    for (int m = 0; m < kMoments; ++m) {
      std::vector<double>& out = mean_[m];
      std::fill(out.begin(), out.end(), 0.0);
      // Rows outside the image are zero padding and add nothing.
      for (int row = std::max(0, y - kRadius); row <= std::min(height_ - 1, y + kRadius); ++row) {
        const double weight = window_[row - y + kRadius];
        const double* in = ring_[row % kTaps][m].data();
        for (int x = 0; x < width_; ++x) out[x] += weight * in[x];
      }
    }
    double total = 0;
    for (int x = 0; x < width_; ++x) {
      if (valid && !valid[x]) continue;
      const double r = mean_[kRender][x];
      const double t = mean_[kTruth][x];
      const double variance = mean_[kRender2][x] - r * r + mean_[kTruth2][x] - t * t;
      const double covariance = mean_[kProduct][x] - r * t;
      total += (2 * r * t + kC1) * (2 * covariance + kC2) / ((r * r + t * t + kC1) * (variance + kC2));
    }
    return total;
  }

  int width_;
  int height_;
  std::array<double, kTaps> window_ = gaussian_window();
  std::array<std::vector<double>, kMoments> padded_;
  std::array<std::array<std::vector<double>, kMoments>, kTaps> ring_;
  std::array<std::vector<double>, kMoments> mean_;
};

std::size_t count_valid(const TruthImage& truth) {
  if (truth.valid.empty()) return truth.color.size() / 3;
  return static_cast<std::size_t>(std::count_if(truth.valid.begin(), truth.valid.end(), [](auto v) { return v != 0; }));
}

}  // namespace

double psnr(std::span<const float> render, const TruthImage& truth) {
  check_shapes(render, truth);
  const std::size_t pixels = truth.color.size() / 3;
  double sum = 0;
  for (std::size_t i = 0; i < truth.color.size(); ++i) {
    if (!truth.valid.empty() && !truth.valid[i % pixels]) continue;
    const double difference = std::clamp(static_cast<double>(render[i]), 0.0, 1.0) - truth_value(truth.color[i]);
    sum += difference * difference;
  }
  // This includes images without a valid pixel.
  if (sum == 0) return kEqual;
  const double decibel = 10 * std::log10(3.0 * static_cast<double>(count_valid(truth)) / sum);
  // Floats represent n/255 only to 2⁻²⁵, so equal images reach this line with a value far above 100. NaN is returned as
  // it is, so that it gets noticed.
  return decibel > kEqual ? kEqual : decibel;
}

double ssim(std::span<const float> render, const TruthImage& truth) {
  check_shapes(render, truth);
  const std::size_t pixels = truth.color.size() / 3;
  const std::size_t valid = count_valid(truth);
  if (valid == 0) return 1;
  ChannelSsim channel(truth.width, truth.height);
  double sum = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    sum += channel.sum(render.data() + c * pixels, truth.color.data() + c * pixels,
                       truth.valid.empty() ? nullptr : truth.valid.data());
  }
  return sum / (3.0 * static_cast<double>(valid));
}

}  // namespace splatboost
