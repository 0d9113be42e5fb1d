// SPDX-License-Identifier: Apache-2.0
#include "loss/cuda_ops.h"
#include "loss/ssim_cuda.h"

namespace splatboost::cuda {
namespace {

/// Size of the planes, and the width of their margin without windows, px.
struct SsimImage {
  ImageSize size;
  int border;
  __device__ bool has_window(int x, int y) const {
    return x >= border && y >= border && x < size.width - border && y < size.height - border;
  }
};

__global__ void __launch_bounds__(kSsimThreads)
    ssim_kernel(SsimImage image, DeviceView<const float> images, DeviceView<const float> truths,
                DeviceView<float> derivatives, DeviceView<double> sums) {
  __shared__ TilePixels image_tile, truth_tile;
  __shared__ TileRows rows[4];
  __shared__ SharedArray<float, kSsimThreads / 32> warps;
  const SsimTilePixel pixel;
  const std::size_t first = blockIdx.z * image.size.pixels();
  for_tile_pixels([&](int k, int x, int y) {
    const bool holds = image.size.holds(x, y);
    image_tile.set(k, holds ? images[first + image.size.at(x, y)] : 0.0f);
    truth_tile.set(k, holds ? truths[first + image.size.at(x, y)] : 0.0f);
  });
  __syncthreads();
  const SsimPixel<float> s = ssim_of_tile(image_tile, truth_tile, rows, pixel);
  const bool counts = image.has_window(pixel.x, pixel.y);
  if (!derivatives.empty() && image.size.holds(pixel.x, pixel.y)) {
    const std::size_t at = first + image.size.at(pixel.x, pixel.y);
    derivatives[at] = counts ? s.d_mean : 0.0f;
    derivatives[images.size() + at] = counts ? s.d_square : 0.0f;
    derivatives[2 * images.size() + at] = counts ? s.d_product : 0.0f;
  }
  const float value[] = {counts ? s.value : 0.0f};
  const double sum = block_sum(value, warps);
  if (threadIdx.x == 0) sums[block_number()] = sum;
}

__global__ void __launch_bounds__(kSsimThreads)
    ssim_gradient_kernel(ImageSize size, DeviceView<const float> images, DeviceView<const float> truths,
                         DeviceView<const float> derivatives, float weight, DeviceView<float> gradient) {
  __shared__ TileDerivatives tile;
  const SsimTilePixel pixel;
  const std::size_t first = blockIdx.z * size.pixels();
  float sums[3];
  tile.blur(
      pixel,
      [&](std::size_t q, int x, int y) {
        return size.holds(x, y) ? derivatives[q * images.size() + first + size.at(x, y)] : 0.0f;
      },
      sums);
  if (!size.holds(pixel.x, pixel.y)) return;
  const std::size_t at = first + size.at(pixel.x, pixel.y);
  gradient[at] = weight * (sums[0] + 2.0f * images[at] * sums[1] + truths[at] * sums[2]);
}

}  // namespace

void ssim(const SsimPlanes& planes, std::span<const float> images, std::span<const float> truths, int border,
          std::span<float> gradient, std::span<double> mean, CudaSsimWorkspace& workspace) {
  CudaStream& stream = workspace.sums.stream();
  const ImageSize size{planes.width, planes.height};
  const dim3 blocks = ssim_blocks(planes.width, planes.height, planes.count);
  const double windows = static_cast<double>(planes.count) * (planes.width - 2 * border) * (planes.height - 2 * border);
  workspace.derivatives.ensure(gradient.empty() ? 0 : 3 * images.size());
  workspace.sums.ensure(static_cast<std::size_t>(blocks.x) * blocks.y * blocks.z);
  launch(stream, "ssim", ssim_kernel, blocks, dim3(kSsimThreads), SsimImage{size, border}, images, truths,
         workspace.derivatives.span(), workspace.sums.span());
  launch(stream, "ssim_mean", sum_blocks_kernel<1>, dim3(1), dim3(kSsimThreads),
         std::span<const double>(workspace.sums.span()), 1.0 / windows, mean);
  if (gradient.empty()) return;
  launch(stream, "ssim_gradient", ssim_gradient_kernel, blocks, dim3(kSsimThreads), size, images, truths,
         std::span<const float>(workspace.derivatives.span()), static_cast<float>(1.0 / windows), gradient);
}

}  // namespace splatboost::cuda
