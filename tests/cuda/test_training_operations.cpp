// SPDX-License-Identifier: Apache-2.0
// Operations of a trainer on its arrays between rasterizing and Adam, on a CUDA device; against the CPU.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "cuda/cuda_device.h"
#include "splatboost/activations.h"
#include "splatboost/array.h"
#include "splatboost/clearance.h"
#include "splatboost/density_statistics.h"
#include "splatboost/dropout.h"
#include "splatboost/elementwise.h"
#include "splatboost/photometric.h"
#include "splatboost/rows.h"
#include "splatboost/smoothing.h"
#include "splatboost/truth_store.h"
#include "support/scenes.h"

namespace splatboost::test {
namespace {

constexpr std::size_t kCount = 701;

/// Runs a test's body on both devices.
class CudaTrainingOperations : public OnCuda<> {
 protected:
  /// @param body gets a device, and returns its results
  template <class Body>
  void expect_same(const Body& body, float tolerance = 0) {
    const std::vector<float> expected = body(Device(threads_)), found = body(Device(stream()));
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
      ASSERT_NEAR(found[i], expected[i], tolerance * (1 + std::abs(expected[i]))) << i;
    }
  }
  Threads threads_{2};
};

TEST_F(CudaTrainingOperations, Arithmetic) {
  const std::vector<float> a = numbers(kCount, -2, 2, 1), b = numbers(kCount, -2, 2, 2);
  expect_same(
      [&](Device device) {
        Array<float> values(device, a), products(device);
        scale(values, 1.25f, device);
        products.ensure(kCount);
        const Array<float> factors(device, b);
        multiply(values, factors, products, device);
        add_products(values, factors, products, device);
        multiply(products, factors, products, device);
        clamp_above(values, 1, device);
        clear_from(values, 1, products, device);
        average_in(values, 0.3f, products, device);
        return products.to_host();
      },
      1e-6f);
}

TEST_F(CudaTrainingOperations, NotANumberIsNotClamped) {
  DeviceArray<float> values(stream(), std::vector<float>{std::nanf(""), 2, 0.5f, -INFINITY});
  clamp_above(values.span(), 1, stream());
  const std::vector<float> found = values.to_host();
  EXPECT_TRUE(std::isnan(found[0]));
  EXPECT_EQ(std::vector<float>(found.begin() + 1, found.end()), (std::vector<float>{1, 0.5f, -INFINITY}));
}

TEST_F(CudaTrainingOperations, GradientsOfActivations) {
  const std::vector<float> scales = numbers(kCount, 0, 3, 3), opacities = numbers(kCount, 0, 1, 4);
  for (const bool sigmoid : {false, true}) {
    expect_same(
        [&](Device device) {
          Array<float> gradients(device, numbers(kCount, -1, 1, 5));
          const Array<float> values(device, sigmoid ? opacities : scales);
          if (sigmoid) {
            sigmoid_gradients(values, gradients, device);
          } else {
            exponential_gradients(values, gradients, device);
          }
          return gradients.to_host();
        },
        1e-6f);
  }
}

TEST_F(CudaTrainingOperations, DropoutIsTheSameDraw) {
  for (const double rate : {0.0, 0.2, 0.9}) {
    expect_same([&](Device device) {
      Array<float> factors(device);
      factors.ensure(kCount);
      dropout_factors(RandomStream(5, 77, RandomPurpose::dropout), rate, factors, device);
      return factors.to_host();
    });
  }
}

TEST_F(CudaTrainingOperations, DensityStatistics) {
  std::vector<std::uint8_t> visible(kCount);
  for (std::size_t i = 0; i < kCount; ++i) visible[i] = i % 3 == 0 ? 1 : 0;
  for (const AbsoluteNorm norm : {AbsoluteNorm::euclidean, AbsoluteNorm::sum}) {
    for (const bool absolute : {false, true}) {
      expect_same(
          [&](Device device) {
            Array<float> norms(device), norms_abs(device), views(device), means(device), means_abs(device),
                longest(device);
            for (Array<float>* each : {&norms, &norms_abs, &views}) each->assign_zeros(kCount);
            for (Array<float>* each : {&means, &means_abs, &longest}) each->ensure(kCount);
            const Array<std::uint8_t> seen(device, visible);
            const Array<float> screen(device, numbers(2 * kCount, -1, 1, 6));
            const Array<float> screen_abs(device, absolute ? numbers(2 * kCount, 0, 1, 7) : std::vector<float>());
            const ScreenGradientSums sums{norms, norms_abs, views};
            for (int round = 0; round < 2; ++round) {
              add_screen_gradients({seen, screen, screen_abs, 640, 480}, norm, 1.25f, sums, device);
            }
            mean_screen_gradients(sums, means, means_abs, device);
            longest_scales(Array<float>(device, numbers(3 * kCount, 0, 1, 8)), longest, device);
            std::vector<float> all = means.to_host();
            for (const Array<float>* each : {&means_abs, &views, &longest}) {
              const std::vector<float> more = each->to_host();
              all.insert(all.end(), more.begin(), more.end());
            }
            return all;
          },
          1e-6f);
    }
  }
}

TEST_F(CudaTrainingOperations, CameraClearances) {
  std::vector<float> distances = numbers(50, 0.1f, 2, 11);
  distances[7] = 0;
  expect_same(
      [&](Device device) {
        Array<float> clearances(device);
        clearances.ensure(kCount);
        camera_clearances(Array<float>(device, numbers(3 * kCount, -3, 3, 9)),
                          Array<float>(device, numbers(3 * 50, -3, 3, 10)), Array<float>(device, distances), clearances,
                          device);
        return clearances.to_host();
      },
      1e-6f);
}

TEST_F(CudaTrainingOperations, SmoothingFilters) {
  std::vector<Camera> views(3);
  for (std::size_t v = 0; v < views.size(); ++v) {
    views[v].width = views[v].height = 100;
    views[v].fx = views[v].fy = 80.0f + 10.0f * static_cast<float>(v);
    views[v].cx = views[v].cy = 50;
    views[v].camera_from_world[3] = glm::vec4(0.3f * static_cast<float>(v), 0, static_cast<float>(v), 1);
  }
  for (const std::size_t n : {std::size_t{0}, std::size_t{1}, kCount}) {
    expect_same(
        [&](Device device) {
          SmoothingFilters smoothing(views, 0.2, 0.15, device);
          const Array<float> means(device, numbers(3 * n, -3, 5, 9));  // in front of, behind and beside the cameras
          Array<float> filters(device);
          filters.ensure(n);
          smoothing.compute(means, filters);
          smoothing.compute(means, filters);  // does not depend on the previous call
          return filters.to_host();
        },
        1e-6f);
  }
}

TEST_F(CudaTrainingOperations, SmoothedGaussiansAndTheirGradients) {
  expect_same(
      [&](Device device) {
        std::vector<float> thin = numbers(3 * kCount, 0, 0.1, 10);
        thin[0] = 0;
        const Array<float> scales(device, thin), opacities(device, numbers(kCount, 0, 1, 11));
        const Array<float> filters(device, numbers(kCount, 0.01, 0.1, 12));
        Array<float> out_scales(device), out_opacities(device), factors(device);
        out_scales.ensure(3 * kCount);
        out_opacities.ensure(kCount);
        factors.ensure(kCount);
        const SmoothedGaussians smoothed{out_scales, out_opacities, factors};
        smooth_gaussians(scales, opacities, filters, smoothed, device);
        Array<float> scale_gradients(device, numbers(3 * kCount, -1, 1, 13));
        Array<float> opacity_gradients(device, numbers(kCount, -1, 1, 14));
        const Array<float> of_scales(device, numbers(3 * kCount, -1, 1, 15));
        const Array<float> of_opacities(device, numbers(kCount, -1, 1, 16));
        smooth_gaussians_backward(scales, filters, smoothed, {of_scales, of_opacities}, scale_gradients,
                                  opacity_gradients, device);
        std::vector<float> all;
        for (const Array<float>* each : {&out_scales, &out_opacities, &factors, &scale_gradients, &opacity_gradients}) {
          const std::vector<float> more = each->to_host();
          all.insert(all.end(), more.begin(), more.end());
        }
        return all;
      },
      1e-5f);
}

TEST_F(CudaTrainingOperations, RowsAreSelectedAndAppended) {
  for (const std::size_t width : {1u, 3u, 45u}) {
    expect_same([&](Device device) {
      Array<float> tensor(device, numbers(kCount * width, -1, 1, width)), workspace(device);
      std::vector<std::uint8_t> removed(kCount);
      for (std::size_t i = 0; i < kCount; ++i) removed[i] = i % 3 == 1 ? 9 : 0;
      select_rows(tensor, width, Array<std::uint32_t>(device, kept_rows(removed)), workspace);
      append_rows(tensor, width, Array<std::uint32_t>(device, {5, 0, 5, 100}));
      append_zero_rows(tensor, width, 2);
      std::vector<std::uint32_t> order(tensor.size() / width);
      for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<std::uint32_t>(i * 7 % order.size());
      select_rows(tensor, width, Array<std::uint32_t>(device, order), workspace);
      append_rows_of(Array<float>(device, numbers(9 * width, 0, 1, 50)), width, Array<std::uint32_t>(device, {8, 8, 1}),
                     tensor);
      tensor.edit(2 * width, [](std::span<float> values) {
        for (float& value : values) value += 1;
      });
      return tensor.to_host();
    });
  }
}

TEST_F(CudaTrainingOperations, AllRowsOrNoneMayGo) {
  expect_same([](Device device) {
    Array<float> tensor(device, {1, 2, 3, 4}), workspace(device);
    select_rows(tensor, 2, Array<std::uint32_t>(device, {0, 1}), workspace);
    EXPECT_EQ(tensor.to_host(), (std::vector<float>{1, 2, 3, 4}));
    select_rows(tensor, 2, {}, workspace);
    EXPECT_EQ(tensor.size(), 0u);
    append_rows(tensor, 2, {});
    append_zero_rows(tensor, 2, 1);
    return tensor.to_host();
  });
}

TEST_F(CudaTrainingOperations, ReservedRoomIsTakenWithoutAnAllocation) {
  Array<float> tensor(stream(), std::vector<float>{1, 2, 3});
  tensor.reserve(1000);
  const std::uint64_t before = stream().activity().allocations;
  tensor.resize(1000);
  EXPECT_EQ(stream().activity().allocations, before);
  tensor.resize(3);
  EXPECT_EQ(tensor.to_host(), (std::vector<float>{1, 2, 3}));
}

/// Ground-truth images of several sizes, some with a mask.
struct Truths {
  explicit Truths(std::size_t n) {
    Numbers random(20);
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t pixels = 13 * (10 + i);
      for (std::size_t p = 0; p < 3 * pixels; ++p) colors[i].push_back(static_cast<std::uint8_t>(random.bits()));
      if (i % 2 == 1) valid[i].assign(pixels, static_cast<std::uint8_t>(i));
    }
    for (std::size_t i = 0; i < n; ++i) images.push_back({13, static_cast<int>(10 + i), colors[i], valid[i]});
  }
  std::vector<std::uint8_t> colors[8], valid[8];
  std::vector<TruthImage> images;
};

TEST_F(CudaTrainingOperations, TruthImagesAreKeptWithinABudgetAndUploadedBeyondIt) {
  const Truths truths(6);
  const std::size_t first_two = truths.colors[0].size() + truths.colors[1].size() + truths.valid[1].size();
  for (const std::size_t budget : {std::size_t{0}, first_two, std::size_t{1} << 20}) {
    TruthStore store(truths.images, budget, stream());
    EXPECT_EQ(store.kept(), budget == 0 ? 0u : budget == first_two ? 2u : 6u);
    CudaActivity before;
    std::uint64_t waits = 0;
    for (int round = 0; round < 3; ++round) {
      if (round == 2) before = stream().activity();
      std::size_t step = 0;
      for (const std::size_t i : {5u, 0u, 3u, 1u, 4u, 2u, 5u}) {
        if (round == 2 && step++ % 2 == 0) {  // keeps the device at most two uploads behind
          stream().synchronize();
          ++waits;
        }
        const TruthImage there = store.get(i);
        EXPECT_EQ(there.width, truths.images[i].width);
        EXPECT_EQ(there.height, truths.images[i].height);
        if (round == 2) continue;
        EXPECT_EQ(copy_to_host(there.color, stream()), truths.colors[i]);
        EXPECT_EQ(copy_to_host(there.valid, stream()), truths.valid[i]);
      }
    }
    EXPECT_EQ(stream().activity().allocations, before.allocations);
    EXPECT_EQ(stream().activity().synchronizations, before.synchronizations + waits);
  }
  TruthStore on_host(truths.images, 0, threads_);
  EXPECT_EQ(on_host.get(3).color.data(), truths.colors[3].data());
}

TEST_F(CudaTrainingOperations, TruthImagesOutsideTheStoreAreUploadedWithoutAWait) {
  const Truths truths(4);
  TruthStore store({}, 0, stream());
  for (const std::size_t i : {0u, 3u, 1u, 2u, 3u}) {  // grows its memory at the first two
    const TruthImage there = store.upload(truths.images[i]);
    EXPECT_EQ(there.height, truths.images[i].height);
    EXPECT_EQ(copy_to_host(there.color, stream()), truths.colors[i]);
    EXPECT_EQ(copy_to_host(there.valid, stream()), truths.valid[i]);
  }
  const CudaActivity before = stream().activity();
  store.upload(truths.images[1]);
  store.upload(truths.images[2]);
  EXPECT_EQ(stream().activity().allocations, before.allocations);
  EXPECT_EQ(stream().activity().synchronizations, before.synchronizations);
  TruthStore on_host({}, 0, threads_);
  EXPECT_EQ(on_host.upload(truths.images[3]).valid.data(), truths.valid[3].data());
}

TEST_F(CudaTrainingOperations, LossesComeBackWithoutAWait) {
  const Truths truths(1);
  const TruthImage& truth = truths.images[0];
  const Array<std::uint8_t> color(stream(), truths.colors[0]);
  const TruthImage there{truth.width, truth.height, color, {}};
  Photometric photometric(stream()), exact(stream());
  Array<float> gradient(stream()), exact_gradient(stream());
  gradient.ensure(color.size());
  exact_gradient.ensure(color.size());
  std::vector<double> losses;
  std::vector<float> image = numbers(color.size(), 0, 1, 30);
  CudaActivity before;
  for (int call = 0; call < 100; ++call) {
    image[7] = call == 90 ? std::numeric_limits<float>::quiet_NaN() : 0.01f * static_cast<float>(call);
    const Array<float> render(stream(), image);
    losses.push_back(exact.evaluate(render, there, 0.2f, exact_gradient).total);
    before = stream().activity();
    const double newest = photometric.evaluate_ahead(render, there, 0.2f, gradient).total;
    if (call > 0) {
      EXPECT_EQ(stream().activity().allocations, before.allocations);
      EXPECT_EQ(stream().activity().synchronizations, before.synchronizations);
    }
    if (call < 90) {
      EXPECT_NE(std::find(losses.begin(), losses.end(), newest), losses.end()) << "it is of this call or one before";
      EXPECT_EQ(gradient.to_host(), exact_gradient.to_host());
    }
  }
  const Array<float> fine(stream(), numbers(color.size(), 0, 1, 30));
  static_cast<void>(photometric.evaluate_ahead(fine, there, 0.2f, gradient));
  stream().synchronize();
  EXPECT_TRUE(std::isnan(photometric.evaluate_ahead(fine, there, 0.2f, gradient).total)) << "one NaN is not missed";
  EXPECT_TRUE(std::isnan(photometric.evaluate(fine, there, 0.2f, gradient).total)) << "nor by evaluate()";
  EXPECT_EQ(photometric.evaluate(fine, there, 0.2f, gradient).total, exact.evaluate(fine, there, 0.2f, gradient).total);
}

TEST_F(CudaTrainingOperations, TheOldestOfManyPendingLossesIsNotMissed) {
  const Truths truths(1);
  const TruthImage& truth = truths.images[0];
  const Array<std::uint8_t> color(stream(), truths.colors[0]);
  const TruthImage there{truth.width, truth.height, color, {}};
  Photometric photometric(stream());
  Array<float> gradient(stream());
  gradient.ensure(color.size());
  std::vector<float> image = numbers(color.size(), 0, 1, 30);
  const Array<float> fine(stream(), image);
  image[7] = std::numeric_limits<float>::quiet_NaN();
  const Array<float> broken(stream(), image);
  static_cast<void>(photometric.evaluate_ahead(fine, there, 0.2f, gradient));
  static_cast<void>(photometric.evaluate_ahead(broken, there, 0.2f, gradient));
  for (int call = 0; call < 63; ++call) static_cast<void>(photometric.evaluate_ahead(fine, there, 0.2f, gradient));
  EXPECT_TRUE(std::isnan(photometric.evaluate(fine, there, 0.2f, gradient).total));
}

}  // namespace
}  // namespace splatboost::test
