// SPDX-License-Identifier: Apache-2.0
/// @file Sequences in the format of the EuRoC MAV benchmark: two cameras side by side, mav0/cam0 and mav0/cam1, or
/// mav0/cam0 alone.
#pragma once

#include <filesystem>

#include "trainer/sequence/sequence_files.h"

namespace splatboost {

/// Finds images from mav0/cam*/data.csv, calibrations from mav0/cam*/sensor.yaml and true poses of the left camera from
/// mav0/state_groundtruth_estimate0/data.csv. SequenceFiles::stereo is set if there is a mav0/cam1. Throws InputError
/// in one line.
SequenceFiles find_euroc(const std::filesystem::path& source);

}  // namespace splatboost
