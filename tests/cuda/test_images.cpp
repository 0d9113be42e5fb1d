// SPDX-License-Identifier: Apache-2.0
// Losses, flags and scores of images on a CUDA device: the loss against brute force in double precision, flags and
// scores against the CPU, with exactly equal counts.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "cuda/cuda_device.h"
#include "reference/photometric.h"
#include "splatboost/device_array.h"
#include "splatboost/error_map.h"
#include "splatboost/multi_view_scores.h"
#include "splatboost/photometric.h"
#include "splatboost/ssim.h"
#include "splatboost/threads.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

using CudaImages = OnCuda<>;

struct Picture {
  int width = 0, height = 0;
  std::vector<float> render;
  std::vector<std::uint8_t> truth, valid;

  /// @param invalid fraction of masked pixels; 0: no mask
  Picture(int w, int h, double invalid, std::uint64_t seed) : width(w), height(h) {
    Numbers random(seed);
    const auto pixels = static_cast<std::size_t>(w * h);
    for (std::size_t k = 0; k < 3 * pixels; ++k) {
      truth.push_back(static_cast<std::uint8_t>(random.bits() % 256));
      render.push_back(random.real(-0.1, 1.2));
    }
    for (std::size_t k = 0; invalid > 0 && k < pixels; ++k) valid.push_back(random.uniform(0, 1) < invalid ? 0 : 7);
  }
  TruthImage view() const { return {width, height, truth, valid}; }
  reference::ImagePair exact() const {
    reference::ImagePair images{width, height, {render.begin(), render.end()}, {}, valid};
    for (const std::uint8_t byte : truth) images.truth.push_back(byte / 255.0);
    return images;
  }
};

/// A Picture in device memory.
struct DevicePicture {
  int width, height;
  DeviceArray<float> render, gradient, error;
  DeviceArray<std::uint8_t> truth, valid, flagged;

  DevicePicture(CudaStream& stream, const Picture& picture)
      : width(picture.width),
        height(picture.height),
        render(stream, picture.render),
        gradient(stream),
        error(stream),
        truth(stream, picture.truth),
        valid(stream, picture.valid),
        flagged(stream) {
    gradient.ensure(render.size());
    error.ensure(render.size() / 3);
    flagged.ensure(render.size() / 3);
  }
  TruthImage view() const { return {width, height, truth.span(), valid.span()}; }
};

double relative_distance(const std::vector<float>& a, const std::vector<double>& b) {
  double difference = 0, size = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    difference += (a[i] - b[i]) * (a[i] - b[i]);
    size += b[i] * b[i];
  }
  return std::sqrt(difference / size);
}

TEST_F(CudaImages, LossAndGradientAreThoseOfTheReference) {
  Photometric photometric(stream());
  std::uint64_t seed = 0;
  for (const auto& [width, height] : {std::pair{4, 3}, {7, 5}, {16, 16}, {17, 33}, {40, 20}}) {
    for (const double invalid : {0.0, 0.3}) {
      const Picture picture(width, height, invalid, ++seed);
      DevicePicture device(stream(), picture);
      const double lambda = 0.2;
      const PhotometricLoss loss =
          photometric.evaluate(device.render.span(), device.view(), 0.2f, device.gradient.span());
      const reference::Loss exact = reference::photometric(picture.exact(), lambda);
      EXPECT_NEAR(loss.l1, exact.l1, 1e-6);
      EXPECT_NEAR(loss.ssim, exact.ssim, 2e-5);
      EXPECT_NEAR(loss.total, exact.total, 1e-5);
      EXPECT_LT(relative_distance(device.gradient.to_host(), reference::photometric_gradient(picture.exact(), lambda)),
                1e-4)
          << width << "x" << height << " invalid " << invalid;
      EXPECT_EQ(photometric.evaluate(device.render.span(), device.view(), 0.2f, {}).total, loss.total);
    }
  }
}

TEST_F(CudaImages, SsimOfFloatsIsThatOfTheCpu) {
  Threads threads(1);
  CudaSsimWorkspace workspace(stream());
  DeviceArray<double> mean(stream());
  mean.ensure(1);
  Numbers random(5);
  for (const SsimPlanes planes : {SsimPlanes{1, 1, 1}, {2, 11, 12}, {3, 16, 16}, {1, 50, 19}, {6, 17, 33}}) {
    const auto width = static_cast<std::size_t>(planes.width), height = static_cast<std::size_t>(planes.height);
    std::vector<float> images, truths;
    for (std::size_t k = 0; k < planes.count * width * height; ++k) {
      truths.push_back(random.real(0, 1));
      images.push_back(truths.back() + random.real(-0.4, 0.4));
    }
    const DeviceArray<float> device_images(stream(), images), device_truths(stream(), truths);
    DeviceArray<float> device_gradient(stream());
    device_gradient.ensure(images.size());
    for (const SsimPadding padding : {SsimPadding::same, SsimPadding::valid}) {
      if (padding == SsimPadding::valid && (width < 11 || height < 11)) continue;
      std::vector<float> gradient(images.size());
      const double value = ssim(planes, images, truths, padding, gradient, threads);
      ssim(planes, device_images.span(), device_truths.span(), padding, device_gradient.span(), mean.span(), workspace);
      EXPECT_NEAR(mean.to_host()[0], value, 2e-6);
      EXPECT_LT(relative_distance(device_gradient.to_host(), {gradient.begin(), gradient.end()}), 1e-4)
          << planes.count << " of " << width << "x" << height;
      ssim(planes, device_images.span(), device_truths.span(), padding, {}, mean.span(), workspace);
      EXPECT_NEAR(mean.to_host()[0], value, 2e-6);
    }
  }
  EXPECT_THROW(ssim({65536, 1, 1}, {}, {}, SsimPadding::same, {}, mean.span(), workspace), ArgumentError);
}

TEST_F(CudaImages, SsimOfSteadySizesAllocatesNothingAndNeverWaits) {
  const DevicePicture device(stream(), Picture(33, 20, 0, 4));
  DeviceArray<float> gradient(stream());
  gradient.ensure(device.render.size());
  DeviceArray<double> mean(stream());
  mean.ensure(1);
  CudaSsimWorkspace workspace(stream());
  const auto evaluate = [&] {
    ssim({3, 33, 20}, device.render.span(), device.render.span(), SsimPadding::same, gradient.span(), mean.span(),
         workspace);
  };
  evaluate();
  const CudaActivity before = stream().activity(), all_before = CudaStream::total_activity();
  evaluate();
  EXPECT_EQ(stream().activity().allocations, before.allocations);
  EXPECT_EQ(stream().activity().synchronizations, before.synchronizations);
  EXPECT_EQ(CudaStream::total_activity().allocations, all_before.allocations);
  EXPECT_NEAR(mean.to_host()[0], 1, 1e-6);
  EXPECT_EQ(CudaStream::total_activity().synchronizations, all_before.synchronizations + 1);
}

TEST_F(CudaImages, NothingToCompareIsNoErrorAndNoGradient) {
  Picture picture(20, 9, 0, 3);
  picture.valid.assign(20 * 9, 0);
  DevicePicture device(stream(), picture);
  Photometric photometric(stream());
  const PhotometricLoss loss = photometric.evaluate(device.render.span(), device.view(), 0.2f, device.gradient.span());
  EXPECT_EQ(loss.total, 0);
  EXPECT_EQ(loss.ssim, 1);
  for (const float g : device.gradient.to_host()) ASSERT_EQ(g, 0.0f);
}

TEST_F(CudaImages, LossOfSteadySizesAllocatesNothingAndWaitsOnce) {
  DevicePicture device(stream(), Picture(33, 20, 0.2, 4));
  Photometric photometric(stream());
  const auto evaluate = [&] {
    return photometric.evaluate(device.render.span(), device.view(), 0.2f, device.gradient.span());
  };
  const PhotometricLoss first = evaluate();
  const CudaActivity before = stream().activity();
  EXPECT_EQ(evaluate().total, first.total);
  EXPECT_EQ(stream().activity().allocations, before.allocations);
  EXPECT_EQ(stream().activity().synchronizations, before.synchronizations + 1);
}

void expect_equal_flags(CudaStream& stream, const Picture& picture, float tau) {
  Threads threads(1);
  const auto pixels = static_cast<std::size_t>(picture.width * picture.height);
  std::vector<float> error(pixels);
  std::vector<std::uint8_t> flagged(pixels);
  const ErrorCounts counts = flag_errors(picture.render, picture.view(), tau, error, flagged, threads);
  DevicePicture device(stream, picture);
  const ErrorCounts found =
      flag_errors(device.render.span(), device.view(), tau, device.error.span(), device.flagged.span(), stream);
  EXPECT_EQ(found.flagged, counts.flagged);
  EXPECT_EQ(found.valid, counts.valid);
  EXPECT_EQ(found.covered, counts.covered);
  EXPECT_EQ(device.flagged.to_host(), flagged);
  const std::vector<float> errors = device.error.to_host();
  for (std::size_t p = 0; p < pixels; ++p) {
    if (!std::isnan(error[p])) {
      ASSERT_EQ(errors[p], error[p]);
    }
  }
}

TEST_F(CudaImages, FlagsAreThoseOfTheCpu) {
  std::uint64_t seed = 20;
  for (const float tau : {0.0f, 0.1f, 0.5f, 1.0f}) {
    expect_equal_flags(stream(), Picture(40, 21, 0, ++seed), tau);
    expect_equal_flags(stream(), Picture(37, 8, 0.4, ++seed), tau);
  }
  Picture constant(9, 9, 0, 1);
  std::fill(constant.truth.begin(), constant.truth.end(), std::uint8_t{0});
  std::fill(constant.render.begin(), constant.render.end(), 0.25f);
  expect_equal_flags(stream(), constant, 0.1f);
  constant.render[5] = 1.0f;
  constant.render[7] = std::numeric_limits<float>::quiet_NaN();
  expect_equal_flags(stream(), constant, 0.1f);
  constant.valid.assign(81, 0);
  expect_equal_flags(stream(), constant, 0.1f);
}

/// A fake rasterizer of three primitives, each of which is blended in some of the pixels; it counts on the host.
class Cardboard : public RasterizerHook {
 public:
  Cardboard(CudaStream* stream, std::size_t views) : stream_(stream) {
    for (std::size_t v = 0; v < views; ++v) {
      pictures_.emplace_back(24, 18, v % 2 == 0 ? 0.0 : 0.2, v);
      if (stream_ != nullptr) on_device_.emplace_back(*stream_, pictures_.back());
    }
  }
  void set_beta(std::optional<float>) override {}
  std::size_t primitives() const override { return 3; }
  std::size_t scorable_views() const override { return pictures_.size(); }
  ScoredView render_for_score(std::size_t view) override {
    if (stream_ != nullptr) return {on_device_[view].render.span(), on_device_[view].view()};
    return {pictures_[view].render, pictures_[view].view()};
  }
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    std::vector<std::uint8_t> mask(flagged.size());
    std::vector<std::int32_t> sums(counts.size());
    if (stream_ != nullptr) {
      stream_->copy_to_host(mask.data(), flagged.data(), mask.size());
      stream_->copy_to_host(sums.data(), counts.data(), counts.size_bytes());
    } else {
      mask.assign(flagged.begin(), flagged.end());
      sums.assign(counts.begin(), counts.end());
    }
    for (std::size_t p = 0; p < mask.size(); ++p) {
      for (std::size_t i = 0; i < 3; ++i) sums[i] += mask[p] != 0 && p % (i + 1) == 0 ? 1 : 0;
    }
    if (stream_ != nullptr) {
      stream_->copy_to_device(counts.data(), sums.data(), counts.size_bytes());
      stream_->synchronize();
    } else {
      std::copy(sums.begin(), sums.end(), counts.begin());
    }
  }

 private:
  CudaStream* stream_;
  std::vector<Picture> pictures_;
  std::vector<DevicePicture> on_device_;
};

TEST_F(CudaImages, ScoresAreThoseOfTheCpu) {
  Threads threads(1);
  Cardboard host(nullptr, 7), device(&stream(), 7);
  MultiViewScorer on_host(threads), on_device(stream());
  const RandomStream random(3, 100, RandomPurpose::scored_views);
  for (const int views : {3, 5}) {
    const ScoreSums expected = on_host.score(host, {views, 0.1f, 0.2f}, random);
    const ScoreSums& sums = on_device.score(device, {views, 0.1f, 0.2f}, random);
    EXPECT_EQ(sums.views, expected.views);
    EXPECT_EQ(sums.counts, expected.counts);
    for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(sums.weighted_counts[i], expected.weighted_counts[i], 1e-2);
    EXPECT_NEAR(sums.weighted_pixels, expected.weighted_pixels, 1e-2);
    EXPECT_EQ(on_device.mean_pixels(), on_host.mean_pixels());
    EXPECT_EQ(on_device.covered_share(), on_host.covered_share());
    const ScoreSums& without_losses = on_device.score(device, {views, 0.1f, 0.2f, false}, random);
    EXPECT_EQ(without_losses.counts, expected.counts);
    EXPECT_TRUE(without_losses.weighted_counts.empty());
  }
}

}  // namespace
}  // namespace splatboost::test
