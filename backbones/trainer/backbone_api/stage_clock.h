// SPDX-License-Identifier: Apache-2.0
/// @file Wall time by stage of training.
#pragma once

#include <chrono>
#include <map>
#include <optional>
#include <string>

#include "splatboost/cuda_laps.h"
#include "splatboost/device.h"

namespace splatboost {

/// Sums over a run, by stage ("project", "blend", …). On a GPU they are the device's time, which the host does not wait
/// for; stages that were timed elsewhere are of the CPU only.
class StageClock {
 public:
  /// Of the CPU.
  StageClock() = default;
  explicit StageClock(Device device);

  /// Adds the time since the last call (or restart) to `stage`, a literal.
  void lap(const char* stage);
  /// Adds a time that was measured elsewhere; what has passed since the last call counts to no stage.
  void add(const char* stage, double seconds);
  void restart();
  /// On a GPU of what it has done so far: all, once it was waited for.
  const std::map<std::string, double, std::less<>>& seconds() const;

 private:
  void sum_up(const char* stage, double seconds) const;
  void take_laps() const;

  mutable std::map<std::string, double, std::less<>> seconds_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
  mutable std::optional<CudaLaps> laps_;  ///< of a GPU
};

}  // namespace splatboost
