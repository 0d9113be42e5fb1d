// SPDX-License-Identifier: Apache-2.0
/// @file Signals that ask a run to stop: it then keeps what it has and ends.
#pragma once

#include <csignal>
#include <cstddef>

namespace splatboost {

/// Takes SIGINT, SIGTERM, SIGHUP (the terminal was closed) and SIGPIPE (nobody reads the progress any more) while it
/// lives; one at a time. The first of them is noted; the second ends the process at once, except that a second SIGPIPE
/// is ignored. One that was ignored before (nohup, a background job) stays so.
class StopSignals {
 public:
  StopSignals();
  ~StopSignals();
  StopSignals(const StopSignals&) = delete;
  StopSignals& operator=(const StopSignals&) = delete;

  /// The signal that was noted, 0: none. Any thread may ask.
  int caught() const;

 private:
  static constexpr std::size_t kCount = 4;
  struct sigaction previous_[kCount] = {};
};

}  // namespace splatboost
