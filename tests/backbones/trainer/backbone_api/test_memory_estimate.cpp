// SPDX-License-Identifier: Apache-2.0
#include "trainer/backbone_api/memory_estimate.h"
#include "trainer/support/process_info.h"

#include <gtest/gtest.h>

#include "trainer/evaluation/results.h"

namespace splatboost {
namespace {

constexpr std::uint64_t kMebibyte = 1024 * 1024;

Scene two_views() {
  Scene scene;
  for (const int width : {40, 20}) {
    View view;
    view.camera.width = width;
    view.camera.height = 10;
    view.color.resize(static_cast<std::size_t>(30 * width));
    scene.train.push_back(view);
  }
  scene.train[1].valid.resize(200);
  return scene;
}

TEST(MemoryEstimate, CountsPhotosTheLargestViewAndPrimitives) {
  const MemoryEstimate estimate = estimate_memory(two_views(), 0, 100, pixel_memory_bytes());
  EXPECT_EQ(estimate.photo_bytes, 1200u + 600u + 200u);
  const std::uint64_t workspace = estimate.fixed_bytes - estimate.photo_bytes;
  EXPECT_EQ(workspace % 400, 0u);
  EXPECT_GE(workspace / 400, 4u * (3 + 3 + 4));  // image, its gradient, blended tiles
  EXPECT_LE(workspace / 400, 200u);
  EXPECT_EQ(estimate.bytes(7), estimate.fixed_bytes + 700);
}

TEST(MemoryEstimate, CountsWhatTheProcessHolds) {
  const MemoryEstimate small = estimate_memory(two_views(), 50 * kMebibyte, 100, pixel_memory_bytes());
  const MemoryEstimate large = estimate_memory(two_views(), 80 * kMebibyte, 100, pixel_memory_bytes());
  EXPECT_EQ(large.fixed_bytes - small.fixed_bytes, 30 * kMebibyte);
}

TEST(MemoryEstimate, AddsPhotosOfAnotherScale) {
  Scene scene = two_views();
  scene.train_rescaled.resize(2);
  for (View& view : scene.train_rescaled) view.color.resize(5000);
  const MemoryEstimate without = estimate_memory(two_views(), kMebibyte, 100, pixel_memory_bytes());
  const MemoryEstimate with = estimate_memory(scene, kMebibyte, 100, pixel_memory_bytes());
  EXPECT_EQ(with.photo_bytes - without.photo_bytes, 10000u);
  EXPECT_EQ(with.fixed_bytes - without.fixed_bytes, 10000u);
}

TEST(MemoryEstimate, AGaussianHoldsAtLeastItsTensors) {
  EXPECT_GT(gaussian_memory_bytes(), 59u * 4 * 4);
  EXPECT_LT(gaussian_memory_bytes(), 3000u);
}

TEST(MemoryEstimate, IsToldInOneLine) {
  MemoryEstimate estimate;
  estimate.fixed_bytes = 300 * kMebibyte;
  estimate.photo_bytes = 72 * kMebibyte;
  estimate.bytes_per_primitive = 1200;
  EXPECT_EQ(memory_text(estimate, 10000, 0),
            "memory: about 311 MiB at the start (photos 72 MiB), 114 MiB more per 100,000 primitives");
  EXPECT_EQ(memory_text(estimate, 10000, 1000000),
            "memory: about 311 MiB at the start (photos 72 MiB), 114 MiB more per 100,000 primitives; 1.4 GiB at "
            "1,000,000");
}

TEST(MemoryEstimate, WarnsWhereThereIsTooLittle) {
  MemoryEstimate estimate;
  estimate.fixed_bytes = 300 * kMebibyte;
  estimate.bytes_per_primitive = 1024;
  const auto warning = [&](std::size_t cap, std::uint64_t free) {
    return memory_warning(estimate, 1024, cap, 200 * kMebibyte, free * kMebibyte);
  };
  EXPECT_FALSE(warning(0, 101));  // 301 MiB at the start, 200 of which are already resident
  EXPECT_FALSE(warning(0, 0));    // free memory is unknown
  ASSERT_TRUE(warning(0, 100));
  EXPECT_EQ(warning(0, 100)->find('\n'), std::string::npos);
  ASSERT_TRUE(warning(1024 * 1024, 500));
  EXPECT_NE(warning(1024 * 1024, 500)->find("1,048,576 primitives"), std::string::npos);
}

TEST(MemoryEstimate, TheSystemTells) {
  EXPECT_GT(resident_memory_bytes(), kMebibyte);
  // A kernel updates its page counters in batches, so the two may differ by a few pages.
  EXPECT_LE(resident_memory_bytes(), peak_memory_bytes() + kMebibyte);
  EXPECT_GT(free_memory_bytes(), kMebibyte);
}

}  // namespace
}  // namespace splatboost
