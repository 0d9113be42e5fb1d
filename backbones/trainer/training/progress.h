// SPDX-License-Identifier: Apache-2.0
/// @file Progress of long tasks: one updating line on a terminal, otherwise a plain line every few seconds.
#pragma once

#include <chrono>
#include <cstddef>
#include <string>

namespace splatboost {

/// Writes to the standard error stream, so that results on the standard output stay clean.
class Progress {
 public:
  /// @param label shown first; may be empty
  /// @param done iterations that were done before (in a resumed run)
  Progress(std::string label, int total, int done, bool quiet);
  /// Ends the updating line.
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// @param seconds training time of this process so far; pauses are not counted
  void update(int iteration, double loss, std::size_t primitives, double seconds);
  /// Prints a line of its own, even if quiet.
  void note(const std::string& text);

 private:
  void measure_rate(int iteration, double seconds);

  std::string label_;
  int total_;
  bool quiet_;
  bool terminal_;
  bool line_open_ = false;
  std::chrono::steady_clock::time_point shown_;
  int rate_iteration_;
  double rate_seconds_ = 0;
  double rate_ = 0;  ///< recent iterations per second
};

/// "4:05", "1:02:33"
std::string clock_text(double seconds);

}  // namespace splatboost
