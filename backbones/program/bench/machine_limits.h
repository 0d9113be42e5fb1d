// SPDX-License-Identifier: Apache-2.0
/// @file What this machine can do at most: the limits that a kernel's speed is read against.
#pragma once

#include "splatboost/threads.h"

namespace splatboost::program {

struct MachineLimits {
  /// Of a[i] = b[i] + s·c[i] over arrays beyond any cache; 12 bytes an element, as STREAM counts.
  double bytes_per_second = 0;
  /// Single-precision multiply-adds of the instruction set in use, two operations each.
  double operations_per_second = 0;
};

/// The best of a few runs on all threads; takes about 800 MB for a second or two.
MachineLimits measure_limits(Threads& threads);

}  // namespace splatboost::program
