// SPDX-License-Identifier: Apache-2.0
/// @file Signals that ask a run to stop: it then saves its state and ends.
#pragma once

#include <csignal>
#include <cstddef>

namespace splatboost {

/// Handles SIGINT, SIGTERM, SIGHUP (the terminal was closed) and SIGPIPE (the reader of the progress has exited) during
/// its lifetime; at most one instance may exist. The first signal is recorded; the second ends the process at once,
/// except that a second SIGPIPE is ignored. A signal that was ignored before (nohup, a background job) stays ignored.
class StopSignals {
 public:
  StopSignals();
  ~StopSignals();
  StopSignals(const StopSignals&) = delete;
  StopSignals& operator=(const StopSignals&) = delete;

  /// The recorded signal; 0: none. Thread-safe.
  int caught() const;

 private:
  static constexpr std::size_t kCount = 4;
  struct sigaction previous_[kCount] = {};
};

}  // namespace splatboost
