// SPDX-License-Identifier: Apache-2.0
/// @file The scene "moving" of synth.h.
#pragma once

#include "trainer/synth/synth.h"

namespace splatboost {

/// As write_synthetic_scene(), which must have checked the options.
void write_moving_scene(const SynthOptions& options);

}  // namespace splatboost
