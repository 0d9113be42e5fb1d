// SPDX-License-Identifier: Apache-2.0
/// @file Durations of a rasterizer's stages on a GPU. The counterpart of raster_clock.h.
#pragma once

#include "device/cuda_event.h"
#include "splatboost/rasterizer.h"

namespace splatboost::cuda {

/// The events between the stages. A stage that was never recorded takes 0 s.
struct RasterClock {
  explicit RasterClock(CudaStream& of_events) : stream(of_events) {}

  /// Waits for the device.
  RasterSeconds seconds() {
    stream.synchronize();
    return {.project = seconds_between(start, projected),
            .tile_lists = seconds_between(projected, listed),
            .blend = seconds_between(listed, blended),
            .blend_backward = seconds_between(backward_start, blended_backward),
            .project_backward = seconds_between(blended_backward, projected_backward),
            .count = seconds_between(count_start, counted)};
  }

  CudaStream& stream;
  Event start{stream, cudaEventDefault}, projected{stream, cudaEventDefault}, listed{stream, cudaEventDefault},
      blended{stream, cudaEventDefault};
  Event backward_start{stream, cudaEventDefault}, blended_backward{stream, cudaEventDefault},
      projected_backward{stream, cudaEventDefault};
  Event count_start{stream, cudaEventDefault}, counted{stream, cudaEventDefault};
};

}  // namespace splatboost::cuda
