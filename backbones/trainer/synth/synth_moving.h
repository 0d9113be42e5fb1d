// SPDX-License-Identifier: Apache-2.0
/// @file The scene "moving" of synth.h.
#pragma once

#include "trainer/synth/synth.h"

namespace splatboost {

/// As write_synthetic_scene(), whose checks the options have passed.
void write_moving_scene(const SynthOptions& options);

}  // namespace splatboost
