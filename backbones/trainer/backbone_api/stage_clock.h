// SPDX-License-Identifier: Apache-2.0
/// @file Time per stage of training.
#pragma once

#include <chrono>
#include <map>
#include <optional>
#include <string>

#include "splatboost/cuda_laps.h"
#include "splatboost/device.h"

namespace splatboost {

/// Sums over a run, by stage ("project", "blend", …). On a GPU they are device times, measured without making the host
/// wait; times passed to add() are always CPU times.
class StageClock {
 public:
  /// Measures on the CPU.
  StageClock() = default;
  explicit StageClock(Device device);

  /// Adds the time since the last call (or restart) to `stage`, a literal.
  void lap(const char* stage);
  /// Adds a time measured elsewhere; the time since the last call is assigned to no stage.
  void add(const char* stage, double seconds);
  void restart();
  /// On a GPU, covers the work that it has completed so far: wait for the device to get all of it.
  const std::map<std::string, double, std::less<>>& seconds() const;

 private:
  void sum_up(const char* stage, double seconds) const;
  void take_laps() const;

  mutable std::map<std::string, double, std::less<>> seconds_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
  mutable std::optional<CudaLaps> laps_;  ///< on a GPU only
};

}  // namespace splatboost
