// SPDX-License-Identifier: Apache-2.0
#include "common/backbone.h"

namespace splatboost {

void StageClock::lap(std::string_view stage) {
  add(stage, std::chrono::duration<double>(std::chrono::steady_clock::now() - last_).count());
}

void StageClock::add(std::string_view stage, double seconds) {
  restart();
  // The name is copied once a stage: a steady loop allocates nothing.
  const auto found = seconds_.find(stage);
  if (found != seconds_.end()) {
    found->second += seconds;
  } else {
    seconds_.emplace(stage, seconds);
  }
}

void StageClock::restart() { last_ = std::chrono::steady_clock::now(); }

}  // namespace splatboost
