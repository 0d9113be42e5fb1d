// SPDX-License-Identifier: Apache-2.0
/// @file How long a stream's device is at each stage of its work, told without waiting for it.
#pragma once

#include <memory>
#include <optional>

#include "splatboost/cuda_stream.h"

namespace splatboost {

/// Marks points in a stream. The time from one to the next is the device's, and includes what it idled there because
/// the host had given it nothing.
class CudaLaps {
 public:
  /// @param stream must outlive it
  explicit CudaLaps(CudaStream& stream);
  ~CudaLaps();
  CudaLaps(CudaLaps&&) noexcept;
  CudaLaps& operator=(CudaLaps&&) noexcept;

  /// Ends a stage here, which began at the mark before. Waits only where the host is a thousand marks ahead.
  /// @param stage a literal; null: what has passed since the mark before counts to no stage
  void mark(const char* stage);

  struct Lap {
    const char* stage;  ///< not null
    double seconds;
  };
  /// The oldest lap that was not taken yet, if the device has come to its end.
  std::optional<Lap> take();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost
