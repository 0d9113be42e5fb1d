// SPDX-License-Identifier: Apache-2.0
// Part of a library whose callers bring kernels of their own: their tests play these in plain code of the host, which
// may therefore touch the device's memory for as long as the library is loaded, and finds there what was asked for.
#include "cuda_runtime.h"

namespace {
const cuda_on_cpu::DeviceAccess access_of_callers;
[[maybe_unused]] const std::size_t lag_before = cuda_on_cpu::set_lag(0);
}  // namespace
