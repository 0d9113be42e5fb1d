// SPDX-License-Identifier: Apache-2.0
/// @file Durations of a rasterizer's stages on the CPU.
#pragma once

#include <chrono>

namespace splatboost {

/// Runs a stage and measures its duration.
template <class Stage>
void timed(double& seconds, Stage&& stage) {
  const auto start = std::chrono::steady_clock::now();
  stage();
  seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace splatboost
