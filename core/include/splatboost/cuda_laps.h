// SPDX-License-Identifier: Apache-2.0
/// @file Device time of each stage of the work on a stream, measured without waiting for the device.
#pragma once

#include <memory>
#include <optional>

#include "splatboost/cuda_stream.h"

namespace splatboost {

/// Marks points in a stream. The time from one mark to the next is device time; it includes the time that the device
/// idles because the host has queued no work.
class CudaLaps {
 public:
  /// @param stream must outlive this object
  explicit CudaLaps(CudaStream& stream);
  ~CudaLaps();
  CudaLaps(CudaLaps&&) noexcept;
  CudaLaps& operator=(CudaLaps&&) noexcept;

  /// Ends the stage that began at the previous mark. Waits only if the host is a thousand marks ahead of take().
  /// @param stage a string literal; null: the time since the previous mark belongs to no stage
  void mark(const char* stage);

  struct Lap {
    const char* stage;  ///< not null
    double seconds;
  };
  /// The oldest lap not yet taken, if the device has reached its end.
  std::optional<Lap> take();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost
