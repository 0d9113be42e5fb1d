// SPDX-License-Identifier: Apache-2.0
/// @file Context of a draw: which view, at which time, and for what purpose.
#pragma once

#include "splatboost/camera.h"
#include "trainer/dataset/scene.h"

namespace splatboost {

enum class DrawPurpose {
  train,     ///< gradients will be computed; anything random (dropout, jitter) belongs here only
  score,     ///< RasterizerHook::render_for_score()
  evaluate,  ///< Backbone::render()
  surface,   ///< Backbone::render_surface()
};

struct DrawContext {
  const Camera& camera;
  float time = 0;     ///< [0,1], of the view
  int iteration = 0;  ///< of the run, from 1; 0 before the first
  DrawPurpose purpose = DrawPurpose::evaluate;
  const View* view = nullptr;  ///< the training view, or its half-size view; null for evaluate and surface
};

}  // namespace splatboost
