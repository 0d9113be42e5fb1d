// SPDX-License-Identifier: Apache-2.0
/// @file What a backbone knows of a drawing: of which view, at which time, and what for.
#pragma once

#include "splatboost/camera.h"
#include "trainer/dataset/scene.h"

namespace splatboost {

enum class DrawPurpose {
  train,     ///< its gradients are wanted; anything random (dropout, jitter) belongs here only
  score,     ///< RasterizerHook::render_for_score()
  evaluate,  ///< Backbone::render()
  surface,   ///< Backbone::render_surface()
};

struct DrawContext {
  const Camera& camera;
  float time = 0;     ///< [0,1], the view's own
  int iteration = 0;  ///< of the run, from 1; 0 before the first
  DrawPurpose purpose = DrawPurpose::evaluate;
  const View* view = nullptr;  ///< the training view, or its half; null in evaluation and of surfaces
};

}  // namespace splatboost
