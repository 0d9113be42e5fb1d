// SPDX-License-Identifier: Apache-2.0
/// @file Stages of a training step that a rasterizer times itself.
#pragma once

#include "splatboost/device.h"
#include "trainer/backbone_api/stage_clock.h"

namespace splatboost {

/// Records the parts of a forward pass. On a GPU they are one stage, because querying the parts would wait for it.
template <class AnyRasterizer>
void lap_forward(const AnyRasterizer& rasterizer, Device device, StageClock& clock) {
  if (device.is_cuda()) return clock.lap("render");
  clock.add("project", rasterizer.seconds().project);
  clock.add("tile_lists", rasterizer.seconds().tile_lists);
  clock.add("blend", rasterizer.seconds().blend);
}

/// Records the parts of a backward pass, likewise.
template <class AnyRasterizer>
void lap_backward(const AnyRasterizer& rasterizer, Device device, StageClock& clock) {
  if (device.is_cuda()) return clock.lap("render_backward");
  clock.add("blend_backward", rasterizer.seconds().blend_backward);
  clock.add("project_backward", rasterizer.seconds().project_backward);
}

}  // namespace splatboost
