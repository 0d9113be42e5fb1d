// SPDX-License-Identifier: Apache-2.0
#include "reference/photometric.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "reference/dual.h"

namespace splatboost::reference {
namespace {

constexpr int kHalf = 5;  // half size of the 11×11 window
constexpr double kSigma = 1.5;
constexpr double kC1 = 0.01 * 0.01;
constexpr double kC2 = 0.03 * 0.03;
using Number = Dual<1>;

/// The window's weight at an offset: a product of two normalised Gaussians.
double window(int dx, int dy) {
  static const std::array<double, 2 * kHalf + 1> weights = [] {
    std::array<double, 2 * kHalf + 1> result{};
    double sum = 0;
    for (int k = -kHalf; k <= kHalf; ++k) {
      result[static_cast<std::size_t>(k + kHalf)] = std::exp(-k * k / (2 * kSigma * kSigma));
      sum += result[static_cast<std::size_t>(k + kHalf)];
    }
    for (double& weight : result) weight /= sum;
    return result;
  }();
  return weights[static_cast<std::size_t>(dx + kHalf)] * weights[static_cast<std::size_t>(dy + kHalf)];
}

bool counts(const ImagePair& images, std::size_t pixel) { return images.valid.empty() || images.valid[pixel] != 0; }

std::size_t valid_pixels(const ImagePair& images) {
  std::size_t number = 0;
  const std::size_t pixels = static_cast<std::size_t>(images.width) * static_cast<std::size_t>(images.height);
  for (std::size_t pixel = 0; pixel < pixels; ++pixel) number += counts(images, pixel) ? 1 : 0;
  return number;
}

/// SSIM of the window around a pixel. The derivative is with respect to the render's element `seed`.
template <class Scalar>
Scalar ssim_at(const ImagePair& images, int channel, int x, int y, std::size_t seed) {
  Scalar mean_r(0);
  Scalar mean_t(0);
  Scalar square_r(0);
  Scalar square_t(0);
  Scalar product(0);
  const std::size_t width = static_cast<std::size_t>(images.width);
  const std::size_t pixels = width * static_cast<std::size_t>(images.height);
  for (int dy = -kHalf; dy <= kHalf; ++dy) {
    for (int dx = -kHalf; dx <= kHalf; ++dx) {
      if (x + dx < 0 || x + dx >= images.width || y + dy < 0 || y + dy >= images.height) continue;
      const std::size_t pixel = static_cast<std::size_t>(y + dy) * width + static_cast<std::size_t>(x + dx);
      const std::size_t element = static_cast<std::size_t>(channel) * pixels + pixel;
      const double t = images.truth[element];
      Scalar r(counts(images, pixel) ? images.render[element] : t);
      if constexpr (!std::is_same_v<Scalar, double>) {
        if (element == seed && counts(images, pixel)) r.slopes[0] = 1;
      }
      const double weight = window(dx, dy);
      mean_r += weight * r;
      mean_t += weight * t;
      square_r += weight * (r * r);
      square_t += weight * (t * t);
      product += weight * (r * t);
    }
  }
  const Scalar variance_r = square_r - mean_r * mean_r;
  const Scalar variance_t = square_t - mean_t * mean_t;
  const Scalar covariance = product - mean_r * mean_t;
  return ((2.0 * mean_r * mean_t + kC1) * (2.0 * covariance + kC2)) /
         ((mean_r * mean_r + mean_t * mean_t + kC1) * (variance_r + variance_t + kC2));
}

}  // namespace

Loss photometric(const ImagePair& images, double lambda) {
  const std::size_t width = static_cast<std::size_t>(images.width);
  const std::size_t pixels = width * static_cast<std::size_t>(images.height);
  Loss loss;
  for (int channel = 0; channel < 3; ++channel) {
    for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
      if (!counts(images, pixel)) continue;
      const std::size_t element = static_cast<std::size_t>(channel) * pixels + pixel;
      loss.l1 += std::abs(images.render[element] - images.truth[element]);
      loss.ssim +=
          ssim_at<double>(images, channel, static_cast<int>(pixel % width), static_cast<int>(pixel / width), 0);
    }
  }
  const double number = 3.0 * static_cast<double>(valid_pixels(images));
  loss.l1 /= number;
  loss.ssim /= number;
  loss.total = (1 - lambda) * loss.l1 + lambda * (1 - loss.ssim);
  return loss;
}

std::vector<double> photometric_gradient(const ImagePair& images, double lambda,
                                         const std::vector<std::size_t>& elements) {
  const std::size_t width = static_cast<std::size_t>(images.width);
  const std::size_t pixels = width * static_cast<std::size_t>(images.height);
  const double number = 3.0 * static_cast<double>(valid_pixels(images));
  std::vector<std::size_t> wanted = elements;
  if (wanted.empty()) {
    wanted.resize(3 * pixels);
    std::iota(wanted.begin(), wanted.end(), std::size_t{0});
  }
  std::vector<double> result;
  for (const std::size_t element : wanted) {
    const std::size_t pixel = element % pixels;
    const int channel = static_cast<int>(element / pixels);
    double slope = 0;
    if (counts(images, pixel)) {
      const double difference = images.render[element] - images.truth[element];
      slope = (1 - lambda) * (difference > 0 ? 1 : difference < 0 ? -1 : 0) / number;
      const int x = static_cast<int>(pixel % width);
      const int y = static_cast<int>(pixel / width);
      // The element contributes to the windows of all pixels within half a window of it.
      for (int wy = std::max(0, y - kHalf); wy <= std::min(images.height - 1, y + kHalf); ++wy) {
        for (int wx = std::max(0, x - kHalf); wx <= std::min(images.width - 1, x + kHalf); ++wx) {
          if (!counts(images, static_cast<std::size_t>(wy) * width + static_cast<std::size_t>(wx))) continue;
          slope -= lambda * ssim_at<Number>(images, channel, wx, wy, element).slopes[0] / number;
        }
      }
    }
    result.push_back(slope);
  }
  return result;
}

ErrorMap error_map(const ImagePair& images) {
  const std::size_t pixels = static_cast<std::size_t>(images.width) * static_cast<std::size_t>(images.height);
  ErrorMap map{std::vector<double>(pixels), std::vector<double>(pixels)};
  double least = 1e300;
  double most = -1e300;
  for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
    for (std::size_t c = 0; c < 3; ++c) {
      map.error[pixel] += std::abs(images.render[c * pixels + pixel] - images.truth[c * pixels + pixel]) / 3;
    }
    if (!counts(images, pixel)) continue;
    least = std::min(least, map.error[pixel]);
    most = std::max(most, map.error[pixel]);
  }
  for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
    if (counts(images, pixel)) map.normalized[pixel] = (map.error[pixel] - least) / (most - least + 1e-8);
  }
  return map;
}

}  // namespace splatboost::reference
