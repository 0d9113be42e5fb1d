// SPDX-License-Identifier: Apache-2.0
/// @file Stages of a training step that a rasterizer times itself.
#pragma once

#include "splatboost/device.h"
#include "trainer/backbone_api/stage_clock.h"

namespace splatboost {

/// The parts of a forward pass. On a GPU, where asking for them would wait, they are one stage.
template <class AnyRasterizer>
void lap_forward(const AnyRasterizer& rasterizer, Device device, StageClock& clock) {
  if (device.is_cuda()) return clock.lap("render");
  clock.add("project", rasterizer.seconds().project);
  clock.add("tile_lists", rasterizer.seconds().tile_lists);
  clock.add("blend", rasterizer.seconds().blend);
}

/// Those of a backward pass.
template <class AnyRasterizer>
void lap_backward(const AnyRasterizer& rasterizer, Device device, StageClock& clock) {
  if (device.is_cuda()) return clock.lap("render_backward");
  clock.add("blend_backward", rasterizer.seconds().blend_backward);
  clock.add("project_backward", rasterizer.seconds().project_backward);
}

}  // namespace splatboost
