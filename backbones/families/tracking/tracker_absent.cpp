// SPDX-License-Identifier: Apache-2.0
#include "families/tracking/tracker.h"
#include "trainer/support/input_error.h"

namespace splatboost {

bool have_tracking() { return false; }

struct Tracker::State {};

Tracker::Tracker(const Calibration&, const TrackerOptions&) {
  throw InputError(
      "this build cannot track a camera: Ceres or OpenCV was not found; run scripts/install-deps --all, then "
      "scripts/build again");
}
Tracker::~Tracker() = default;
TrackedFrame Tracker::track(const SequenceFrame&) { return {}; }
std::size_t Tracker::keyframes() const { return 0; }
bool Tracker::on_trial() const { return false; }
glm::dmat4 Tracker::camera_from_world(std::size_t) const { return glm::dmat4(1.0); }
glm::dmat4 Tracker::camera_from_world(const TrackedFrame&) const { return glm::dmat4(1.0); }
std::size_t Tracker::frame_of(std::size_t) const { return 0; }
std::size_t Tracker::map_points() const { return 0; }
const LackOfMap& Tracker::lack_of_map() const {
  static const LackOfMap none;
  return none;
}
PointCloud Tracker::cloud() const { return {}; }
int Tracker::loops() const { return 0; }
std::optional<double> Tracker::better_focal_factor() const { return {}; }
MapChange Tracker::take_change() { return {}; }

}  // namespace splatboost
