// SPDX-License-Identifier: Apache-2.0
// Effects of C ABI calls on a GPU and its streams, on the emulator: order, waits, allocations, devices, memory.
#include <cuda_runtime.h>
#include <gtest/gtest.h>
#include <splatboost/c_api.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace splatboost::test {
namespace {

constexpr std::int64_t kWidth = 40, kHeight = 25, kPixels = kWidth * kHeight;

template <class T>
constexpr std::int32_t type_of() {
  if (std::is_same_v<T, float>) return SB_FLOAT32;
  if (std::is_same_v<T, double>) return SB_FLOAT64;
  if (std::is_same_v<T, std::int32_t>) return SB_INT32;
  return std::is_same_v<T, std::int64_t> ? SB_INT64 : SB_UINT8;
}

/// Memory that the host and the emulated device share.
template <class T>
struct Memory {
  std::vector<T> values;
  sb_tensor tensor{};

  explicit Memory(std::vector<std::int64_t> shape, T value = T{}) {
    std::int64_t size = 1;
    tensor.type = type_of<T>();
    tensor.dimensions = static_cast<std::int32_t>(shape.size());
    tensor.device_kind = SB_CUDA;
    for (std::size_t d = shape.size(); d-- > 0;) {
      tensor.shape[d] = shape[d];
      tensor.strides[d] = size;
      size *= shape[d];
    }
    values.assign(static_cast<std::size_t>(size), value);
    tensor.data = values.data();
  }
  Memory(const Memory&) = delete;
  Memory& operator=(const Memory&) = delete;
};

struct Stream {
  cudaStream_t handle = nullptr;
  Stream() { static_cast<void>(cudaStreamCreateWithFlags(&handle, cudaStreamNonBlocking)); }
  ~Stream() { static_cast<void>(cudaStreamDestroy(handle)); }
};

/// N Gaussians in a row in front of a camera, and all outputs of calls with them.
struct Scene {
  std::int64_t n;
  sb_camera camera{};
  sb_raster_options options{};
  Memory<float> means{{n, 3}}, scales{{n, 3}, 0.05f}, rotations{{n, 4}, 0.5f}, opacities{{n}, 0.7f},
      colors{{n, 3}, 0.6f};
  Memory<float> image{{3, kHeight, kWidth}}, g_image{{3, kHeight, kWidth}, 1.0f}, g_means{{n, 3}}, g_opacities{{n}};
  Memory<float> images{{1, 3, kHeight, kWidth}, 0.5f}, truths{{1, 3, kHeight, kWidth}, 0.4f},
      g_images{{1, 3, kHeight, kWidth}};
  Memory<double> mean{{1}};
  Memory<float> first{{n, 3}}, second{{n, 3}};
  Memory<std::int32_t> radii{{n}}, counts{{n}};
  Memory<std::uint8_t> flags{{kHeight, kWidth}, 1};
  sb_gaussians gaussians{};

  explicit Scene(std::int64_t count) : n(count) {
    camera.width = kWidth;
    camera.height = kHeight;
    camera.fx = camera.fy = 30;
    camera.cx = kWidth / 2;
    camera.cy = kHeight / 2.0f;
    for (int i = 0; i < 4; ++i) camera.camera_from_world[5 * i] = 1;
    EXPECT_EQ(sb_raster_options_default(&options), SB_OK);
    for (std::int64_t i = 0; i < n; ++i) {
      const auto at = static_cast<std::size_t>(3 * i);
      means.values[at] = -1.2f + 2.4f * static_cast<float>(i) / static_cast<float>(n);
      means.values[at + 1] = 0.5f * std::sin(static_cast<float>(i));
      means.values[at + 2] = 2.0f;
    }
    gaussians.means = &means.tensor;
    gaussians.scales = &scales.tensor;
    gaussians.rotations = &rotations.tensor;
    gaussians.opacities = &opacities.tensor;
    gaussians.colors = &colors.tensor;
  }

  sb_status forward(sb_rasterizer* rasterizer, void* stream) {
    sb_raster_outputs outputs{};
    outputs.color = &image.tensor;
    outputs.radii = &radii.tensor;
    return sb_rasterizer_forward(rasterizer, &camera, &gaussians, &options, &outputs, stream);
  }
  sb_status backward(sb_rasterizer* rasterizer, void* stream) {
    sb_image_gradients from{};
    from.color = &g_image.tensor;
    sb_gaussian_gradients to{};
    to.means = &g_means.tensor;
    to.opacities = &g_opacities.tensor;
    return sb_rasterizer_backward(rasterizer, &gaussians, &from, &to, stream);
  }
  sb_status count(sb_rasterizer* rasterizer, void* stream) {
    return sb_rasterizer_count_flagged(rasterizer, &flags.tensor, &counts.tensor, stream);
  }
  sb_status ssim(void* stream) {
    const sb_device device{SB_CUDA, 0, 0, stream};
    return sb_ssim(&device, &images.tensor, &truths.tensor, 0, &g_images.tensor, &mean.tensor);
  }
  sb_status neighbors() {
    const sb_device device{SB_CUDA, 0, 0, nullptr};
    return sb_mean_squared_neighbor_distances(&device, &means.tensor, 3, &g_opacities.tensor);
  }
  sb_status adam(void* stream) {
    const sb_device device{SB_CUDA, 0, 0, stream};
    const sb_adam_options adam{1e-4f, 0.9f, 0.999f, 1e-15f};
    return sb_adam_step(&device, &means.tensor, &g_means.tensor, &first.tensor, &second.tensor, 1, &adam);
  }
};

struct Activity {
  std::int64_t allocations = 0, waits = 0;
  Activity() { EXPECT_EQ(sb_cuda_activity(&allocations, &waits), SB_OK); }
};

class CudaCalls : public ::testing::Test {
 protected:
  void SetUp() override { ASSERT_EQ(sb_rasterizer_create(&device_, &rasterizer_), SB_OK) << sb_last_error(); }
  void TearDown() override {
    sb_rasterizer_destroy(rasterizer_);
    cuda_on_cpu::set_device_count(1);
    cuda_on_cpu::set_device_memory(std::size_t{4} << 30);
  }
  const sb_device device_{SB_CUDA, 0, 0, nullptr};
  sb_rasterizer* rasterizer_ = nullptr;
};

TEST_F(CudaCalls, ASteadyLoopNeitherAllocatesNorWaits) {
  Scene scene(200);
  Stream streams[2];
  const auto iteration = [&](void* stream) {
    EXPECT_EQ(scene.forward(rasterizer_, stream), SB_OK) << sb_last_error();
    EXPECT_EQ(scene.ssim(stream), SB_OK);
    EXPECT_EQ(scene.backward(rasterizer_, stream), SB_OK);
    EXPECT_EQ(scene.count(rasterizer_, stream), SB_OK);
    EXPECT_EQ(scene.adam(stream), SB_OK);
  };
  iteration(nullptr);
  const Activity before;
  EXPECT_GT(before.allocations, 0);
  EXPECT_GT(before.waits, 0);  // in the first forward pass
  for (int k = 0; k < 6; ++k) iteration(k < 2 ? nullptr : streams[k % 2].handle);
  const Activity after;
  EXPECT_EQ(after.allocations, before.allocations);
  EXPECT_EQ(after.waits, before.waits);
  EXPECT_GT(*std::max_element(scene.counts.values.begin(), scene.counts.values.end()), 0);

  std::int64_t visible = 0;
  EXPECT_EQ(sb_rasterizer_counts(rasterizer_, &visible, nullptr, nullptr), SB_OK);
  EXPECT_GT(visible, 100);
  EXPECT_GT(Activity().waits, after.waits);  // results that are copied to the host
}

TEST_F(CudaCalls, WhatSharesAWorkspaceIsInOrderOnAnyStream) {
  Scene scene(50);
  const std::vector<std::function<sb_status(void*)>> calls = {
      [&](void* stream) { return scene.forward(rasterizer_, stream); },
      [&](void* stream) { return scene.backward(rasterizer_, stream); },
      [&](void* stream) { return scene.count(rasterizer_, stream); },
  };
  Stream before;
  ASSERT_EQ(calls[0](before.handle), SB_OK);
  for (int round = 0; round < 2; ++round) {
    for (const auto& call : calls) {
      Stream stream;
      ASSERT_EQ(call(stream.handle), SB_OK) << sb_last_error();
      EXPECT_TRUE(cuda_on_cpu::comes_after(stream.handle, before.handle));
      EXPECT_FALSE(cuda_on_cpu::comes_after(before.handle, stream.handle));
      std::swap(stream.handle, before.handle);  // destroys the previous stream
    }
  }
  // Calls without a handle share a workspace too.
  Stream first, second;
  ASSERT_EQ(scene.ssim(first.handle), SB_OK);
  ASSERT_EQ(scene.ssim(second.handle), SB_OK);
  EXPECT_TRUE(cuda_on_cpu::comes_after(second.handle, first.handle));
}

TEST_F(CudaCalls, TheThreadsDeviceStaysWhatItWas) {
  cuda_on_cpu::set_device_count(2);
  ASSERT_EQ(cudaSetDevice(1), cudaSuccess);
  Scene scene(5);
  EXPECT_EQ(scene.forward(rasterizer_, nullptr), SB_OK);
  EXPECT_EQ(scene.adam(nullptr), SB_OK);
  scene.means.tensor.device_index = 1;
  EXPECT_EQ(scene.adam(nullptr), SB_ERROR_ARGUMENT);  // one tensor is on a different device than the call
  EXPECT_NE(std::string(sb_last_error()).find("values: expected memory of CUDA device 0, got memory of CUDA device 1"),
            std::string::npos)
      << sb_last_error();
  int device = -1;
  EXPECT_EQ(cudaGetDevice(&device), cudaSuccess);
  EXPECT_EQ(device, 1);
  ASSERT_EQ(cudaSetDevice(0), cudaSuccess);
}

TEST_F(CudaCalls, TooLittleMemorySaysHowMuchAndLeavesTheHandleUsable) {
  Scene scene(300);
  cuda_on_cpu::set_device_memory(cuda_on_cpu::device_memory_in_use() + 3000);
  EXPECT_EQ(scene.forward(rasterizer_, nullptr), SB_ERROR_MEMORY);
  const std::string text = sb_last_error();
  EXPECT_NE(text.find("bytes requested"), std::string::npos) << text;
  EXPECT_NE(text.find("free"), std::string::npos) << text;
  EXPECT_EQ(scene.backward(rasterizer_, nullptr), SB_ERROR_ARGUMENT);  // nothing was drawn
  EXPECT_EQ(scene.neighbors(), SB_ERROR_MEMORY);
  cuda_on_cpu::set_device_memory(std::size_t{4} << 30);
  EXPECT_EQ(scene.forward(rasterizer_, nullptr), SB_OK) << sb_last_error();
  EXPECT_EQ(scene.backward(rasterizer_, nullptr), SB_OK);
  EXPECT_EQ(scene.neighbors(), SB_OK);
}

TEST_F(CudaCalls, AViewThatOutgrowsTheRoomIsMendedBySettling) {
  Scene many(2000);
  many.opacities.values.assign(many.opacities.values.size(), 0.01f);
  many.scales.values.assign(many.scales.values.size(), 0.001f);
  ASSERT_EQ(many.forward(rasterizer_, nullptr), SB_OK);
  many.scales.values.assign(many.scales.values.size(), 0.5f);  // each now overlaps all tiles
  ASSERT_EQ(many.forward(rasterizer_, nullptr), SB_OK);
  const std::vector<float> drawn = many.image.values;
  const Activity before;
  std::int32_t redrawn = -1;
  ASSERT_EQ(sb_rasterizer_settle(rasterizer_, &redrawn, nullptr), SB_OK);
  EXPECT_GT(Activity().waits, before.waits);
  EXPECT_EQ(redrawn, 1);
  EXPECT_NE(many.image.values, drawn);
  sb_rasterizer* fresh = nullptr;
  ASSERT_EQ(sb_rasterizer_create(&device_, &fresh), SB_OK);
  const std::vector<float> settled = many.image.values;
  ASSERT_EQ(many.forward(fresh, nullptr), SB_OK);  // a rasterizer's first view is exact
  EXPECT_EQ(many.image.values, settled);
  sb_rasterizer_destroy(fresh);
}

TEST_F(CudaCalls, AMachineWithoutADeviceIsNamed) {
  EXPECT_EQ(sb_has_device(SB_CUDA), 1);
  cuda_on_cpu::set_device_count(0);
  EXPECT_EQ(sb_has_device(SB_CUDA), 0);
  sb_rasterizer* none = nullptr;
  EXPECT_EQ(sb_rasterizer_create(&device_, &none), SB_ERROR_NO_CUDA);
  EXPECT_EQ(none, nullptr);
  EXPECT_NE(std::string(sb_last_error()).find("no CUDA device 0 on this machine"), std::string::npos);
  Scene scene(5);
  EXPECT_EQ(scene.forward(rasterizer_, nullptr), SB_ERROR_NO_CUDA);
  EXPECT_EQ(scene.adam(nullptr), SB_ERROR_NO_CUDA);
}

}  // namespace
}  // namespace splatboost::test
