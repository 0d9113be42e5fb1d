// SPDX-License-Identifier: Apache-2.0
#include "trainer/backbone_api/stage_clock.h"

namespace splatboost {

StageClock::StageClock(Device device) {
  if (device.is_cuda()) laps_.emplace(device.stream());
}

void StageClock::lap(const char* stage) {
  if (laps_) return laps_->mark(stage);
  sum_up(stage, std::chrono::duration<double>(std::chrono::steady_clock::now() - last_).count());
  restart();
}

void StageClock::add(const char* stage, double seconds) {
  sum_up(stage, seconds);
  restart();
}

void StageClock::restart() {
  last_ = std::chrono::steady_clock::now();
  if (!laps_) return;
  take_laps();
  laps_->mark(nullptr);
}

const std::map<std::string, double, std::less<>>& StageClock::seconds() const {
  take_laps();
  return seconds_;
}

void StageClock::sum_up(const char* stage, double seconds) const {
  // The name is copied only once per stage, so that a steady loop does not allocate.
  const auto found = seconds_.find(stage);
  if (found != seconds_.end()) {
    found->second += seconds;
  } else {
    seconds_.emplace(stage, seconds);
  }
}

void StageClock::take_laps() const {
  while (laps_) {
    const std::optional<CudaLaps::Lap> lap = laps_->take();
    if (!lap) return;
    sum_up(lap->stage, lap->seconds);
  }
}

}  // namespace splatboost
