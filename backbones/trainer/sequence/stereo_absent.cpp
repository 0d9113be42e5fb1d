// SPDX-License-Identifier: Apache-2.0
#include "trainer/sequence/stereo.h"
#include "trainer/support/input_error.h"

namespace splatboost {

struct StereoDepth::Rectified {};

StereoDepth::StereoDepth(const StereoRig&) {
  throw InputError(
      "this build cannot compute depth from stereo pairs: OpenCV was not found; run scripts/install-deps, then "
      "scripts/build again");
}
StereoDepth::~StereoDepth() = default;
const Calibration& StereoDepth::calibration() const {
  static const Calibration none;
  return none;
}
glm::dmat4 StereoDepth::left_from_rectified() const { return glm::dmat4(1.0); }
void StereoDepth::rectify_left(std::vector<std::uint8_t>&, std::vector<std::uint8_t>&) const {}
std::vector<float> StereoDepth::depth(const std::vector<std::uint8_t>&, std::vector<std::uint8_t>) const { return {}; }

}  // namespace splatboost
