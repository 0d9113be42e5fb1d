// SPDX-License-Identifier: Apache-2.0
#include "trainer/training/stop_signals.h"

#include <atomic>
#include <iterator>

namespace splatboost {
namespace {

constexpr int kStopSignals[] = {SIGINT, SIGTERM, SIGHUP, SIGPIPE};

// Lock-free atomics are the only shared state that a signal handler may access besides volatile sig_atomic_t.
std::atomic<int> g_stop_signal = 0;
static_assert(std::atomic<int>::is_always_lock_free);

extern "C" void note_stop_signal(int signal_number) {
  g_stop_signal = signal_number;
  // A second signal ends the process at once, but further writes to a closed pipe must not.
  for (const int stop : kStopSignals) std::signal(stop, stop == SIGPIPE ? SIG_IGN : SIG_DFL);
}

}  // namespace

StopSignals::StopSignals() {
  static_assert(std::size(kStopSignals) == kCount);
  g_stop_signal = 0;
  struct sigaction action {};
  action.sa_handler = note_stop_signal;
  sigemptyset(&action.sa_mask);
  action.sa_flags = SA_RESTART;
  for (std::size_t i = 0; i < kCount; ++i) {
    sigaction(kStopSignals[i], nullptr, &previous_[i]);
    if (previous_[i].sa_handler != SIG_IGN) sigaction(kStopSignals[i], &action, nullptr);
  }
}

StopSignals::~StopSignals() {
  for (std::size_t i = 0; i < kCount; ++i) {
    // Keep ignoring SIGPIPE: the caller still reports what happened, possibly into the closed pipe.
    if (kStopSignals[i] == SIGPIPE && g_stop_signal == SIGPIPE) continue;
    sigaction(kStopSignals[i], &previous_[i], nullptr);
  }
}

int StopSignals::caught() const { return g_stop_signal; }

}  // namespace splatboost
