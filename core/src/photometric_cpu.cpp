// SPDX-License-Identifier: Apache-2.0
#include "splatboost/photometric.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "buffer.h"
#include "photometric_math.h"
#include "splatboost/errors.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "photometric_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once an instruction set
#include <hwy/highway.h>

#ifndef SPLATBOOST_PHOTOMETRIC_JOB_
#define SPLATBOOST_PHOTOMETRIC_JOB_
namespace splatboost {

/// One channel of the images and what is wanted of it. Planes are [H,W].
struct PhotometricJob {
  std::size_t width, height;
  const float* render;
  const std::uint8_t* truth;
  const std::uint8_t* valid;  ///< null: all
  float* d_mean;              ///< d SSIM / d blurred render
  float* d_square;            ///< d SSIM / d blurred render²
  float* d_product;           ///< d SSIM / d blurred render·truth
  float* gradient;            ///< null: value only
  float l1_weight;            ///< d total / d |render − truth| of one pixel
  float ssim_weight;          ///< d total / d SSIM of one pixel
};

/// Rows of an image that are handled together: enough to make the window's halo of 2×5 rows cheap.
inline constexpr std::size_t kBandRows = 32;
inline constexpr std::size_t kHalo = kSsimRadius;

/// Row buffers of one band; wide enough for the padding on both sides.
struct PhotometricRows {
  Buffer<float> padded;      ///< [3, W + 2·halo] render, truth, and a product of the two
  Buffer<float> horizontal;  ///< [quantities, band + 2·halo, W]
};

struct PhotometricSums {
  double l1 = 0;
  double ssim = 0;
};

}  // namespace splatboost
#endif  // SPLATBOOST_PHOTOMETRIC_JOB_

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

/// Plain loops: the compiler vectorises them for each instruction set that this file is compiled for.

/// to[x] = Σ_k window[k]·padded[x + k]
void blur_row(const float* HWY_RESTRICT padded, std::size_t width, float* HWY_RESTRICT to) {
  for (std::size_t x = 0; x < width; ++x) {
    float sum = kSsimWindow[kHalo] * padded[x + kHalo];
    for (std::size_t k = 0; k < kHalo; ++k) sum += kSsimWindow[k] * (padded[x + k] + padded[x + 2 * kHalo - k]);
    to[x] = sum;
  }
}

/// to[x] = Σ_k window[k]·rows[k][x], rows `stride` apart
void blur_column(const float* HWY_RESTRICT rows, std::size_t stride, std::size_t width, float* HWY_RESTRICT to) {
  for (std::size_t x = 0; x < width; ++x) {
    float sum = kSsimWindow[kHalo] * rows[kHalo * stride + x];
    for (std::size_t k = 0; k < kHalo; ++k) {
      sum += kSsimWindow[k] * (rows[k * stride + x] + rows[(2 * kHalo - k) * stride + x]);
    }
    to[x] = sum;
  }
}

void multiply_rows(const float* HWY_RESTRICT a, const float* HWY_RESTRICT b, std::size_t n, float* HWY_RESTRICT to) {
  for (std::size_t x = 0; x < n; ++x) to[x] = a[x] * b[x];
}

/// Truth and render of one row as floats; where a pixel is not valid the render reads as truth.
void load_row(const PhotometricJob& job, std::size_t y, float* HWY_RESTRICT render, float* HWY_RESTRICT truth) {
  const float* from = job.render + y * job.width;
  const std::uint8_t* bytes = job.truth + y * job.width;
  for (std::size_t x = 0; x < job.width; ++x) truth[x] = static_cast<float>(bytes[x]) * (1.0f / 255.0f);
  if (job.valid == nullptr) {
    std::memcpy(render, from, job.width * sizeof(float));
  } else {
    const std::uint8_t* valid = job.valid + y * job.width;
    for (std::size_t x = 0; x < job.width; ++x) render[x] = valid[x] != 0 ? from[x] : truth[x];
  }
}

/// Σ values, with a fixed association that vectorises.
double sum_row(const float* HWY_RESTRICT values, std::size_t n) {
  double partial[8] = {};
  std::size_t x = 0;
  for (; x + 8 <= n; x += 8) {
    for (std::size_t k = 0; k < 8; ++k) partial[k] += static_cast<double>(values[x + k]);
  }
  double sum = 0;
  for (; x < n; ++x) sum += static_cast<double>(values[x]);
  for (const double p : partial) sum += p;
  return sum;
}

/// SSIM of one row from the blurred moments, and its derivatives.
void ssim_row(const float* HWY_RESTRICT mx, const float* HWY_RESTRICT my, const float* HWY_RESTRICT xx,
              const float* HWY_RESTRICT yy, const float* HWY_RESTRICT xy, std::size_t n, float* HWY_RESTRICT value,
              float* HWY_RESTRICT d_mean, float* HWY_RESTRICT d_square, float* HWY_RESTRICT d_product) {
  for (std::size_t x = 0; x < n; ++x) {
    const SsimPixel s = ssim_pixel(mx[x], my[x], xx[x], yy[x], xy[x]);
    value[x] = s.value;
    d_mean[x] = s.d_mean;
    d_square[x] = s.d_square;
    d_product[x] = s.d_product;
  }
}

/// Values of one band of one channel, and the derivative maps.
void photometric_band(const PhotometricJob& job, std::size_t band, PhotometricRows& rows, PhotometricSums& sums) {
  const std::size_t width = job.width, height = job.height;
  const std::size_t first = band * kBandRows, last = std::min(height, first + kBandRows);
  const std::size_t padded_width = width + 2 * kHalo;
  const std::size_t band_rows = last - first + 2 * kHalo;
  rows.padded.ensure(3 * padded_width + 5 * width);
  rows.horizontal.ensure(5 * band_rows * width);
  float* render = rows.padded.data();
  float* truth = render + padded_width;
  float* product = truth + padded_width;
  float* moments = product + padded_width;
  std::fill(rows.padded.data(), rows.padded.data() + 3 * padded_width, 0.0f);
  const std::size_t plane = band_rows * width;
  float* horizontal = rows.horizontal.data();

  double l1 = 0, ssim = 0;
  for (std::size_t r = 0; r < band_rows; ++r) {
    const std::size_t y = first + r - kHalo;  // wraps below zero, and is then beyond the height as well
    float* to = horizontal + r * width;
    if (y >= height) {
      for (std::size_t q = 0; q < 5; ++q) std::memset(to + q * plane, 0, width * sizeof(float));
      continue;
    }
    load_row(job, y, render + kHalo, truth + kHalo);
    if (y >= first && y < last) {
      float* difference = moments;
      for (std::size_t x = 0; x < width; ++x) difference[x] = std::fabs(render[kHalo + x] - truth[kHalo + x]);
      l1 += sum_row(difference, width);
    }
    blur_row(render, width, to);
    blur_row(truth, width, to + plane);
    multiply_rows(render, render, padded_width, product);
    blur_row(product, width, to + 2 * plane);
    multiply_rows(truth, truth, padded_width, product);
    blur_row(product, width, to + 3 * plane);
    multiply_rows(render, truth, padded_width, product);
    blur_row(product, width, to + 4 * plane);
  }
  float* value = product;  // free again
  for (std::size_t y = first; y < last; ++y) {
    for (std::size_t q = 0; q < 5; ++q) {
      blur_column(horizontal + q * plane + (y - first) * width, width, width, moments + q * width);
    }
    const std::size_t at = y * width;
    ssim_row(moments, moments + width, moments + 2 * width, moments + 3 * width, moments + 4 * width, width, value,
             job.d_mean + at, job.d_square + at, job.d_product + at);
    if (job.valid != nullptr) {
      const std::uint8_t* valid = job.valid + at;
      for (std::size_t x = 0; x < width; ++x) {
        const float keep = valid[x] != 0 ? 1.0f : 0.0f;
        value[x] *= keep;
        job.d_mean[at + x] *= keep;
        job.d_square[at + x] *= keep;
        job.d_product[at + x] *= keep;
      }
    }
    ssim += sum_row(value, width);
  }
  sums.l1 = l1;
  sums.ssim = ssim;
}

void gradient_row(const float* HWY_RESTRICT render, const float* HWY_RESTRICT truth, const float* HWY_RESTRICT mean,
                  const float* HWY_RESTRICT square, const float* HWY_RESTRICT product, std::size_t n, float l1_weight,
                  float ssim_weight, float* HWY_RESTRICT gradient) {
  for (std::size_t x = 0; x < n; ++x) {
    const float difference = render[x] - truth[x];
    const float sign = difference > 0.0f ? 1.0f : (difference < 0.0f ? -1.0f : 0.0f);
    gradient[x] = l1_weight * sign + ssim_weight * (mean[x] + 2.0f * render[x] * square[x] + truth[x] * product[x]);
  }
}

/// Gradient of one band of one channel from the derivative maps: the window once more, now as its own adjoint.
void photometric_gradient_band(const PhotometricJob& job, std::size_t band, PhotometricRows& rows) {
  const std::size_t width = job.width, height = job.height;
  const std::size_t first = band * kBandRows, last = std::min(height, first + kBandRows);
  const std::size_t padded_width = width + 2 * kHalo;
  const std::size_t band_rows = last - first + 2 * kHalo;
  rows.padded.ensure(3 * padded_width + 5 * width);
  rows.horizontal.ensure(5 * band_rows * width);
  float* padded = rows.padded.data();
  std::fill(padded, padded + padded_width, 0.0f);
  float* blurred = padded + padded_width;
  float* render = blurred + 3 * width;
  float* truth = render + width;
  const std::size_t plane = band_rows * width;
  float* horizontal = rows.horizontal.data();
  const float* maps[3] = {job.d_mean, job.d_square, job.d_product};

  for (std::size_t r = 0; r < band_rows; ++r) {
    const std::size_t y = first + r - kHalo;
    for (std::size_t q = 0; q < 3; ++q) {
      float* to = horizontal + q * plane + r * width;
      if (y >= height) {
        std::memset(to, 0, width * sizeof(float));
        continue;
      }
      std::memcpy(padded + kHalo, maps[q] + y * width, width * sizeof(float));
      blur_row(padded, width, to);
    }
  }
  for (std::size_t y = first; y < last; ++y) {
    for (std::size_t q = 0; q < 3; ++q) {
      blur_column(horizontal + q * plane + (y - first) * width, width, width, blurred + q * width);
    }
    load_row(job, y, render, truth);
    float* gradient = job.gradient + y * width;
    gradient_row(render, truth, blurred, blurred + width, blurred + 2 * width, width, job.l1_weight, job.ssim_weight,
                 gradient);
    if (job.valid != nullptr) {
      const std::uint8_t* valid = job.valid + y * width;
      for (std::size_t x = 0; x < width; ++x) gradient[x] = valid[x] != 0 ? gradient[x] : 0.0f;
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost {
namespace {
HWY_EXPORT(photometric_band);
HWY_EXPORT(photometric_gradient_band);

/// One band's rows fill half a megabyte: shared by all bands of a thread they stay in its cache.
PhotometricRows& rows_of_thread() {
  thread_local PhotometricRows rows;
  return rows;
}

}  // namespace

struct Photometric::State {
  explicit State(Threads& pool) : threads(pool) {}
  Threads& threads;
  Buffer<float> maps;  ///< [3 derivatives, 3 channels, H, W]
  std::vector<PhotometricSums> sums;
};

Photometric::Photometric(Threads& threads) : state_(std::make_unique<State>(threads)) {}
Photometric::~Photometric() = default;
Photometric::Photometric(Photometric&&) noexcept = default;
Photometric& Photometric::operator=(Photometric&&) noexcept = default;

PhotometricLoss Photometric::evaluate(std::span<const float> render, const TruthImage& truth, float lambda_dssim,
                                      std::span<float> gradient) {
  SPLATBOOST_CHECK(truth.width > 0 && truth.height > 0, "truth.width and truth.height must be above 0");
  const auto width = static_cast<std::size_t>(truth.width), height = static_cast<std::size_t>(truth.height);
  const std::size_t pixels = width * height;
  SPLATBOOST_CHECK(truth.color.size() == 3 * pixels, "truth.color must be [3,H,W]");
  SPLATBOOST_CHECK(truth.valid.empty() || truth.valid.size() == pixels, "truth.valid must be empty or [H,W]");
  SPLATBOOST_CHECK(render.size() == 3 * pixels, "render must be [3,H,W] of the truth's size");
  SPLATBOOST_CHECK(gradient.empty() || gradient.size() == 3 * pixels, "gradient must be empty or [3,H,W]");
  SPLATBOOST_CHECK(lambda_dssim >= 0.0f && lambda_dssim <= 1.0f, "lambda_dssim must lie in [0, 1]");

  std::size_t counted = pixels;
  if (!truth.valid.empty()) {
    counted = static_cast<std::size_t>(
        std::count_if(truth.valid.begin(), truth.valid.end(), [](std::uint8_t v) { return v != 0; }));
  }
  if (counted == 0) {  // nothing to compare: no error, no gradient
    std::fill(gradient.begin(), gradient.end(), 0.0f);
    return {0.0, 1.0, 0.0};
  }
  const double samples = 3.0 * static_cast<double>(counted);

  State& s = *state_;
  s.maps.ensure(9 * pixels);
  const std::size_t bands = (height + kBandRows - 1) / kBandRows;
  s.sums.resize(3 * bands);
  const auto job_of = [&](std::size_t channel) {
    PhotometricJob job;
    job.width = width;
    job.height = height;
    job.render = render.data() + channel * pixels;
    job.truth = truth.color.data() + channel * pixels;
    job.valid = truth.valid.empty() ? nullptr : truth.valid.data();
    job.d_mean = s.maps.data() + (3 * channel) * pixels;
    job.d_square = job.d_mean + pixels;
    job.d_product = job.d_square + pixels;
    job.gradient = gradient.empty() ? nullptr : gradient.data() + channel * pixels;
    job.l1_weight = static_cast<float>((1.0 - static_cast<double>(lambda_dssim)) / samples);
    job.ssim_weight = static_cast<float>(-static_cast<double>(lambda_dssim) / samples);
    return job;
  };
  s.threads.for_range(3 * bands, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      HWY_DYNAMIC_DISPATCH(photometric_band)(job_of(i / bands), i % bands, rows_of_thread(), s.sums[i]);
    }
  });
  if (!gradient.empty()) {
    s.threads.for_range(3 * bands, 1, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        HWY_DYNAMIC_DISPATCH(photometric_gradient_band)(job_of(i / bands), i % bands, rows_of_thread());
      }
    });
  }

  PhotometricLoss loss;
  for (const PhotometricSums& sum : s.sums) {
    loss.l1 += sum.l1;
    loss.ssim += sum.ssim;
  }
  loss.l1 /= samples;
  loss.ssim /= samples;
  const auto lambda = static_cast<double>(lambda_dssim);
  loss.total = (1.0 - lambda) * loss.l1 + lambda * (1.0 - loss.ssim);
  return loss;
}

}  // namespace splatboost
#endif  // HWY_ONCE
