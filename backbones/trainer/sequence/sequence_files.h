// SPDX-License-Identifier: Apache-2.0
/// @file Finds the files of a sequence in the layouts of several datasets.
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
  int video_frame = -1;         ///< index of the frame if `color` is a video, else -1
  std::filesystem::path depth;  ///< depth image, or the right image of a stereo pair; empty: none
  std::optional<glm::dmat4> truth;
};

struct SequenceFiles {
  std::string form;  ///< name of the dataset layout, for messages
  std::vector<FrameFiles> frames;
  Calibration calibration;
  std::optional<StereoRig> stereo;  ///< set if frames are stereo pairs; `calibration` is then of the left camera
  std::vector<std::string> notes;
};

/// Throws InputError in one line.
SequenceFiles find_sequence_files(const SequenceOptions& options);

}  // namespace splatboost
