// SPDX-License-Identifier: Apache-2.0
#include "device/launch.h"
#include "rasterizer/blend_cuda.h"
#include "rasterizer/weight_sums.h"
#include "splatboost/rasterizer.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kTileThreads)
    count_kernel(TileLists lists, DeviceView<const std::uint8_t> flagged, DeviceView<std::int32_t> counts) {
  ThreadPixels pixels(lists, blockIdx.x, threadIdx.x);
  float transmittance[kThreadPixels];
#pragma unroll
  for (int p = 0; p < kThreadPixels; ++p) {  // pixels without a flag need no replay
    pixels.open[p] = pixels.at[p].inside && flagged[pixels.at[p].index(lists)] != 0;
    transmittance[p] = 1.0f;
  }
  if (!__syncthreads_or(pixels.any_open())) return;  // the whole block returns: nothing to count
  visit_splats(lists, blockIdx.x, pixels, [&](const SplatRecord& splat) {
    int counted = 0;
#pragma unroll
    for (int p = 0; p < kThreadPixels; ++p) {
      const PixelStep step = step_pixel(splat, pixels.at[p], transmittance[p], pixels.open[p]);
      if (step.blended) transmittance[p] = step.after;
      counted += __popc(__ballot_sync(kWholeWarp, step.blended));
    }
    if (counted != 0 && threadIdx.x % 32 == 0) atomicAdd(&counts[splat.gaussian], counted);
  });
}

__global__ void __launch_bounds__(kTileThreads)
    observe_kernel(TileLists lists, float min_transmittance, DeviceView<std::int32_t> counts) {
  ThreadPixels pixels(lists, blockIdx.x, threadIdx.x);
  float transmittance[kThreadPixels];
#pragma unroll
  for (int p = 0; p < kThreadPixels; ++p) transmittance[p] = 1.0f;
  visit_splats(lists, blockIdx.x, pixels, [&](const SplatRecord& splat) {
    int counted = 0;
#pragma unroll
    for (int p = 0; p < kThreadPixels; ++p) {
      const PixelStep step = step_pixel(splat, pixels.at[p], transmittance[p], pixels.open[p]);
      if (step.blended) transmittance[p] = step.after;
      counted += __popc(__ballot_sync(kWholeWarp, step.blended));
      pixels.open[p] = pixels.open[p] && transmittance[p] > min_transmittance;  // splats behind are not observed
    }
    if (counted != 0 && threadIdx.x % 32 == 0) atomicAdd(&counts[splat.gaussian], counted);
  });
}

__global__ void __launch_bounds__(kTileThreads) weigh_kernel(TileLists lists, DeviceView<std::int32_t> weights) {
  ThreadPixels pixels(lists, blockIdx.x, threadIdx.x);
  float transmittance[kThreadPixels];
#pragma unroll
  for (int p = 0; p < kThreadPixels; ++p) transmittance[p] = 1.0f;
  visit_splats(lists, blockIdx.x, pixels, [&](const SplatRecord& splat) {
    int weight = 0;
#pragma unroll
    for (int p = 0; p < kThreadPixels; ++p) {
      const PixelStep step = step_pixel(splat, pixels.at[p], transmittance[p], pixels.open[p]);
      if (!step.blended) continue;
      weight += static_cast<int>(rintf(transmittance[p] * step.alpha * (1 / kWeightUnit)));
      transmittance[p] = step.after;
    }
#pragma unroll
    for (int distance = 16; distance > 0; distance /= 2) weight += __shfl_xor_sync(kWholeWarp, weight, distance);
    if (weight != 0 && threadIdx.x % 32 == 0) add_weight(weights[splat.gaussian], weight);
  });
}

}  // namespace

void count_flagged_pixels(const CudaFrame& frame, std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts,
                          CudaStream& stream) {
  launch(stream, "count_flagged", count_kernel, dim3(static_cast<std::uint32_t>(frame.tiles())), dim3(kTileThreads),
         TileLists(frame), flagged, counts);
}

void count_observed_pixels(const CudaFrame& frame, float min_transmittance, std::span<std::int32_t> counts,
                           CudaStream& stream) {
  launch(stream, "count_observed", observe_kernel, dim3(static_cast<std::uint32_t>(frame.tiles())), dim3(kTileThreads),
         TileLists(frame), min_transmittance, counts);
}

void add_blending_weights(const CudaFrame& frame, std::span<std::int32_t> weights, CudaStream& stream) {
  launch(stream, "add_weights", weigh_kernel, dim3(static_cast<std::uint32_t>(frame.tiles())), dim3(kTileThreads),
         TileLists(frame), weights);
}

}  // namespace splatboost::cuda
