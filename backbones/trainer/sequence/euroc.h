// SPDX-License-Identifier: Apache-2.0
/// @file Sequences of the EuRoC MAV benchmark's form: two cameras side by side, mav0/cam0 and mav0/cam1.
#pragma once

#include <filesystem>

#include "trainer/sequence/sequence_files.h"

namespace splatboost {

/// Pictures by mav0/cam*/data.csv, cameras by mav0/cam*/sensor.yaml, true poses of the left camera by
/// mav0/state_groundtruth_estimate0/data.csv. Throws InputError in one line.
SequenceFiles find_euroc(const std::filesystem::path& source);

}  // namespace splatboost
