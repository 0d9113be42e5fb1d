// SPDX-License-Identifier: Apache-2.0
/// @file Peak rates of this machine, with which a kernel's speed is compared.
#pragma once

#include "splatboost/threads.h"

namespace splatboost::program {

struct MachineLimits {
  /// For a[i] = b[i] + s·c[i] over arrays larger than any cache; 12 bytes per element, as STREAM counts.
  double bytes_per_second = 0;
  /// Single-precision multiply-adds of the instruction set in use, two operations each.
  double operations_per_second = 0;
};

/// The best of a few runs on all threads; takes about 800 MB for a second or two.
MachineLimits measure_limits(const Threads& threads);

}  // namespace splatboost::program
