// SPDX-License-Identifier: Apache-2.0
/// @file Image sequences of a moving camera, with or without depth.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <glm/mat4x4.hpp>

namespace splatboost {

/// Intrinsics of the camera of a sequence; the centre of pixel (i, j) is at (i, j), as in OpenCV. Distortion is
/// Brown-Conrady; frames are undistorted when read.
struct Calibration {
  int width = 0, height = 0;  ///< px
  double fx = 0, fy = 0, cx = 0, cy = 0;
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;
  double depth_scale = 0;  ///< value of one metre in depth images; 0: there are none

  bool has_depth() const { return depth_scale > 0; }
};

/// One image, undistorted.
struct SequenceFrame {
  std::size_t number = 0;  ///< in the sequence, from 0
  double time = 0;         ///< s
  std::string name;        ///< of its picture as the dataset lists it, which may include a folder
  int width = 0, height = 0;
  std::vector<std::uint8_t> color;  ///< [H,W,3]; empty: the image cannot be used
  std::vector<std::uint8_t> valid;  ///< [H,W] non-zero where there is colour; empty: everywhere
  std::vector<float> depth;         ///< [H,W] metres along z, 0: not known; empty: none
  std::string problem;              ///< why colour or depth is missing, one line; empty: no problem
};

class Sequence {
 public:
  virtual ~Sequence() = default;
  virtual std::size_t size() const = 0;
  virtual const Calibration& calibration() const = 0;
  /// Whether depth is computed from the calibration, as that of stereo pairs is. It then cannot be used to check it.
  virtual bool computes_depth() const { return false; }
  /// Does not throw if an image is missing or broken: SequenceFrame::problem says what is wrong.
  virtual SequenceFrame read(std::size_t number) = 0;
  /// Time of a frame, seconds.
  virtual double time_of(std::size_t number) const = 0;
  /// SequenceFrame::name of a frame, without reading it.
  virtual std::string name_of(std::size_t number) const = 0;
  /// True world_from_camera, if the dataset has it.
  virtual std::optional<glm::dmat4> truth(std::size_t number) const = 0;
  /// Notes for the user on how the data was read, one line each.
  virtual std::vector<std::string> notes() const { return {}; }
};

struct SequenceOptions {
  std::filesystem::path source;
  std::filesystem::path calibration;  ///< file; empty: the dataset's own
  int first = 0;                      ///< first frame
  int count = 0;                      ///< maximum number of frames; 0: all
  int stride = 1;                     ///< every stride-th frame
};

/// Replica (results/frame*.jpg, depth*.png, traj.txt, cam_params.json), TUM RGB-D (rgb.txt, depth.txt,
/// groundtruth.txt), EuRoC (mav0/: stereo pairs, from which depth is computed, or one camera), a folder of
/// images (images/ and depth/, or colour alone) with calibration.json, or a video with SequenceOptions::calibration.
/// Throws InputError in one line.
std::unique_ptr<Sequence> open_sequence(const SequenceOptions& options);

/// Reads {"width", "height", "fx", "fy", "cx", "cy", "k1", …, "depth_scale"}; Replica's "camera" with "w", "h" and
/// "scale" likewise. Throws InputError naming the file and the key, also for keys that it does not know, and for
/// synonyms with different values.
Calibration read_calibration(const std::filesystem::path& file);

/// Throws InputError, beginning with `where`, if the calibration is not plausible.
void check_calibration(const Calibration& calibration, const std::string& where);

}  // namespace splatboost
