// SPDX-License-Identifier: Apache-2.0
#include "trainer/training/progress.h"

#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <utility>

namespace splatboost {
namespace {

constexpr std::chrono::milliseconds kTerminalInterval{200};
constexpr std::chrono::seconds kPlainInterval{5};
constexpr double kRateWindow = 1.0;  // seconds; shorter windows make the remaining time jump

}  // namespace

Progress::Progress(std::string label, int total, int done, bool quiet)
    : label_(std::move(label)),
      total_(total),
      quiet_(quiet),
      terminal_(isatty(STDERR_FILENO) != 0),
      shown_(std::chrono::steady_clock::now()),
      rate_iteration_(done) {}

Progress::~Progress() {
  if (line_open_) std::fputc('\n', stderr);
}

void Progress::measure_rate(int iteration, double seconds) {
  const double window = seconds - rate_seconds_;
  if (window < kRateWindow && rate_ > 0) return;
  if (window <= 0) return;
  rate_ = (iteration - rate_iteration_) / window;
  if (window < kRateWindow) return;  // provisional rate, until the first window is complete
  rate_iteration_ = iteration;
  rate_seconds_ = seconds;
}

void Progress::update(int iteration, double loss, std::size_t primitives, double seconds) {
  if (quiet_) return;
  const auto now = std::chrono::steady_clock::now();
  const bool last = iteration == total_;
  if (!last && now - shown_ < (terminal_ ? std::chrono::steady_clock::duration(kTerminalInterval)
                                         : std::chrono::steady_clock::duration(kPlainInterval))) {
    return;
  }
  shown_ = now;
  measure_rate(iteration, seconds);
  const double left = rate_ > 0 ? (total_ - iteration) / rate_ : 0;
  std::fprintf(stderr, "%s%s%s%d/%d  loss %.4f  %zu primitives  %.1f it/s  %s left%s", terminal_ ? "\r" : "",
               label_.c_str(), label_.empty() ? "" : "  ", iteration, total_, loss, primitives, rate_,
               clock_text(left).c_str(), terminal_ ? "\x1b[K" : "\n");
  std::fflush(stderr);
  line_open_ = terminal_;
}

void Progress::note(const std::string& text) {
  std::fprintf(stderr, "%s%s\n", line_open_ ? "\r\x1b[K" : "", text.c_str());
  std::fflush(stderr);
  line_open_ = false;
}

std::string clock_text(double seconds) {
  const auto whole = static_cast<long long>(std::ceil(seconds));
  char text[40];
  if (whole >= 3600) {
    std::snprintf(text, sizeof text, "%lld:%02lld:%02lld", whole / 3600, whole / 60 % 60, whole % 60);
  } else {
    std::snprintf(text, sizeof text, "%lld:%02lld", whole / 60, whole % 60);
  }
  return text;
}

}  // namespace splatboost
