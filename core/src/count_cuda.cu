// SPDX-License-Identifier: Apache-2.0
#include "blend_cuda.h"
#include "launch.h"

namespace splatboost::cuda {
namespace {

__global__ void __launch_bounds__(kTilePixels)
    count_kernel(TileLists lists, DeviceView<const std::uint8_t> flagged, DeviceView<std::int32_t> counts) {
  const TilePixel pixel(lists, blockIdx.x, threadIdx.x);
  const bool flag = pixel.inside && flagged[pixel.index(lists)] != 0;
  if (!__syncthreads_or(flag)) return;  // the whole block: there is nothing to count
  bool open = flag;                     // pixels without a flag need not be followed
  float transmittance = 1.0f;
  visit_splats(lists, blockIdx.x, pixel, open, [&](std::uint32_t, std::uint32_t gaussian, const SplatRecord& splat) {
    const PixelStep step = step_pixel(splat, pixel, transmittance, open);
    if (step.blended) transmittance = step.after;
    const unsigned counted = __ballot_sync(kWholeWarp, step.blended);
    if (counted != 0 && threadIdx.x % 32 == 0) atomicAdd(&counts[gaussian], __popc(counted));
  });
}

}  // namespace

void count_flagged_pixels(const CudaFrame& frame, std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts,
                          CudaStream& stream) {
  launch(stream, "count_flagged", count_kernel, dim3(static_cast<std::uint32_t>(frame.tiles())), dim3(kTilePixels),
         TileLists(frame), flagged, counts);
}

}  // namespace splatboost::cuda
