// SPDX-License-Identifier: Apache-2.0
/// @file Which files make up a sequence, by dataset.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <glm/mat4x4.hpp>

#include "trainer/sequence/sequence.h"
#include "trainer/sequence/stereo.h"

namespace splatboost {

struct FrameFiles {
  double time = 0;
  std::filesystem::path color;
  std::filesystem::path depth;  ///< of a pair, the right picture; empty: none
  std::optional<glm::dmat4> truth;
};

struct SequenceFiles {
  std::string form;  ///< as messages call it
  std::vector<FrameFiles> frames;
  Calibration calibration;
  std::optional<StereoRig> stereo;  ///< frames are pairs; the calibration is the left camera's
  std::vector<std::string> notes;
};

/// Throws InputError in one line.
SequenceFiles find_sequence_files(const SequenceOptions& options);

}  // namespace splatboost
