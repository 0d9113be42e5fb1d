// SPDX-License-Identifier: Apache-2.0
/// @file Finds the files of a sequence in the layouts of several datasets.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <glm/mat4x4.hpp>
#include <glm/vec2.hpp>

#include "trainer/images/brown_conrady.h"
#include "trainer/sequence/sequence.h"
#include "trainer/sequence/stereo.h"
#include "trainer/support/input_error.h"

namespace splatboost {

struct FrameFiles {
  double time = 0;
  std::string name;  ///< SequenceFrame::name
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
  /// Why no depth image belongs to a picture, one line; empty: some do, or there are none.
  std::string depth_mismatch;
  std::vector<std::string> notes;
};

/// Throws InputError in one line.
SequenceFiles find_sequence_files(const SequenceOptions& options);

/// Throws InputError, naming `file`, if two of the pictures, sorted by time, have the same time: depth, poses and
/// trajectories are found by it. Lines that are the same may be repeated.
template <class Name>
void require_own_times(const std::vector<std::pair<double, Name>>& pictures, const std::filesystem::path& file) {
  for (std::size_t i = 1; i < pictures.size(); ++i) {
    const auto& [time, name] = pictures[i];
    const auto& [time_before, name_before] = pictures[i - 1];
    require(time != time_before || name == name_before,
            file.string() + ": " + std::filesystem::path(name_before).string() + " and " +
                std::filesystem::path(name).string() + " have the same time; each picture needs its own");
  }
}

/// Notes that a file of true poses has none for any picture. @param of_pictures nearest_in_time() of the pictures
void note_unused_truth(const std::filesystem::path& file, std::span<const std::ptrdiff_t> of_pictures,
                       std::vector<std::string>& notes);

/// Finds the pixels of undistorted images in the distorted ones.
class DistortedPlaces {
 public:
  explicit DistortedPlaces(const Calibration& calibration);

  /// Where the distorted image shows what pixel (column, row) of the undistorted image shows, in pixels; it may be
  /// outside of it. None where the distortion folds the image back over itself.
  std::optional<glm::dvec2> of(double column, double row) const;

 private:
  Calibration calibration_;
  BrownConrady model_;
  double fold_;  ///< BrownConrady::fold_radius()
};

}  // namespace splatboost
