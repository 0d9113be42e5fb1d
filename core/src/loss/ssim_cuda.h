// SPDX-License-Identifier: Apache-2.0
/// @file SSIM of tiles of pixels, one block per tile and one thread per pixel: shared by the photometric loss and
/// ssim() on a GPU. For .cu files.
#pragma once

#include "device/device_view.h"
#include "device/host_device.h"
#include "device/launch.h"
#include "loss/photometric_math.h"

namespace splatboost::cuda {

inline constexpr int kSsimTile = 16;  // px
inline constexpr int kSsimThreads = kSsimTile * kSsimTile;
inline constexpr int kSsimSide = kSsimTile + 2 * kSsimRadius;  // with the halo

struct ImageSize {
  int width, height;
  __device__ bool holds(int x, int y) const { return x >= 0 && y >= 0 && x < width && y < height; }
  __device__ std::size_t pixels() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
  __device__ std::size_t at(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
  }
};

/// One block per tile and plane.
inline dim3 ssim_blocks(int width, int height, std::size_t planes) {
  const auto tiles = [](int length) { return static_cast<unsigned>((length + kSsimTile - 1) / kSsimTile); };
  return dim3(tiles(width), tiles(height), static_cast<unsigned>(planes));
}

/// The pixel of a thread.
struct SsimTilePixel {
  int column = static_cast<int>(threadIdx.x) % kSsimTile, row = static_cast<int>(threadIdx.x) / kSsimTile;
  int x = static_cast<int>(blockIdx.x) * kSsimTile + column, y = static_cast<int>(blockIdx.y) * kSsimTile + row;
};

/// A tile with its halo, and its rows blurred along x.
using TilePixels = SharedArray<float, kSsimSide * kSsimSide>;
using TileRows = SharedArray<float, kSsimSide * kSsimTile>;

/// Calls body(k, x, y) for each pixel k of the tile with its halo, at (x, y) of the image; divided among the threads.
template <class Body>
__device__ void for_tile_pixels(Body body) {
  for (int k = static_cast<int>(threadIdx.x); k < kSsimSide * kSsimSide; k += kSsimThreads) {
    body(k, static_cast<int>(blockIdx.x) * kSsimTile + k % kSsimSide - kSsimRadius,
         static_cast<int>(blockIdx.y) * kSsimTile + k / kSsimSide - kSsimRadius);
  }
}

/// Calls body(k, from) for each place k of the rows, whose window begins at pixel `from` of the tile.
template <class Body>
__device__ void for_tile_rows(Body body) {
  for (int k = static_cast<int>(threadIdx.x); k < kSsimSide * kSsimTile; k += kSsimThreads) {
    body(k, k / kSsimTile * kSsimSide + k % kSsimTile);
  }
}

/// Weight of row or column k, 0 .. 10, of the window. A constant in unrolled loops.
__device__ inline float window_weight(int k) {
  constexpr float kWeights[] = {kSsimWindow[0], kSsimWindow[1], kSsimWindow[2],
                                kSsimWindow[3], kSsimWindow[4], kSsimWindow[5]};
  return kWeights[k <= kSsimRadius ? k : 2 * kSsimRadius - k];
}

/// Blurs along y the rows that were blurred along x.
__device__ inline float blur_down(const TileRows& rows, const SsimTilePixel& pixel) {
  float sum = 0;
#pragma unroll
  for (int k = 0; k <= 2 * kSsimRadius; ++k) {
    sum += window_weight(k) * rows.get((pixel.row + k) * kSsimTile + pixel.column);
  }
  return sum;
}

/// Derivatives of the SSIM of a tile with its halo.
struct TileDerivatives {
  TilePixels maps[3];
  TileRows rows[3];  ///< workspace

  /// Blurs the maps into sums, those of the thread's pixel. The window is its own adjoint.
  /// @param value (q, x, y): derivative q of a pixel, 0 outside the image
  template <class Value>
  __device__ void blur(const SsimTilePixel& pixel, Value value, float (&sums)[3]) {
    for_tile_pixels([&](int k, int x, int y) {
      for (int q = 0; q < 3; ++q) maps[q].set(k, value(static_cast<std::size_t>(q), x, y));
    });
    __syncthreads();
    for_tile_rows([&](int k, int from) {
      for (int q = 0; q < 3; ++q) {
        float sum = 0;
#pragma unroll
        for (int j = 0; j <= 2 * kSsimRadius; ++j) sum += window_weight(j) * maps[q].get(from + j);
        rows[q].set(k, sum);
      }
    });
    __syncthreads();
    for (int q = 0; q < 3; ++q) sums[q] = blur_down(rows[q], pixel);
  }
};

/// SSIM of the thread's pixel. @param rows workspace
__device__ inline SsimPixel<float> ssim_of_tile(const TilePixels& renders, const TilePixels& truths,
                                                TileRows (&rows)[4], const SsimTilePixel& pixel) {
  for_tile_rows([&](int k, int from) {
    float ra = 0, rb = 0, squares = 0, product = 0;
#pragma unroll
    for (int j = 0; j <= 2 * kSsimRadius; ++j) {
      const float weight = window_weight(j), a = renders.get(from + j), b = truths.get(from + j);
      ra += weight * a;
      rb += weight * b;
      squares += weight * (a * a + b * b);
      product += weight * (a * b);
    }
    rows[0].set(k, ra);
    rows[1].set(k, rb);
    rows[2].set(k, squares);
    rows[3].set(k, product);
  });
  __syncthreads();
  return ssim_pixel(blur_down(rows[0], pixel), blur_down(rows[1], pixel), blur_down(rows[2], pixel),
                    blur_down(rows[3], pixel));
}

/// Index of the block in the grid: where its sums are stored.
__device__ inline std::size_t block_number() {
  return (static_cast<std::size_t>(blockIdx.z) * gridDim.y + blockIdx.y) * gridDim.x + blockIdx.x;
}

/// Sums of `Quantities` values over the threads of a block, in a fixed order: thread q gets that of values[q].
/// @param warps workspace, one element per quantity and warp; a second use needs a barrier before it
template <int Quantities, class T>
__device__ double block_sum(const T (&values)[Quantities], SharedArray<T, Quantities * kSsimThreads / 32>& warps) {
  constexpr int kWarps = kSsimThreads / 32;
  const int thread = static_cast<int>(threadIdx.x);
  for (int q = 0; q < Quantities; ++q) {
    const T sum = warp_sum(values[q]);
    if (thread % 32 == 0) warps.set(q * kWarps + thread / 32, sum);
  }
  __syncthreads();
  double total = 0;
  if (thread < Quantities) {
    for (int w = 0; w < kWarps; ++w) total += static_cast<double>(warps.get(thread * kWarps + w));
  }
  return total;
}

/// Adds up the sums of all blocks, `Quantities` per block, in a fixed order. Launched with one block.
template <int Quantities>
__global__ void __launch_bounds__(kSsimThreads)
    sum_blocks_kernel(DeviceView<const double> sums, double factor, DeviceView<double> totals) {
  __shared__ SharedArray<double, Quantities * kSsimThreads / 32> warps;
  double parts[Quantities] = {};
  for (std::size_t i = threadIdx.x; Quantities * i < sums.size(); i += kSsimThreads) {
    for (std::size_t q = 0; q < Quantities; ++q) parts[q] += sums[Quantities * i + q];
  }
  const double total = block_sum(parts, warps);
  if (threadIdx.x < Quantities) totals[threadIdx.x] = factor * total;
}

}  // namespace splatboost::cuda
