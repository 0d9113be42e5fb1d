// SPDX-License-Identifier: Apache-2.0
// Part of the emulated library, for callers with their own kernels. Their tests imitate these in plain host code, so
// device memory stays accessible while the library is loaded, and work is executed as soon as it is queued.
#include "cuda_runtime.h"

namespace {
const cuda_on_cpu::DeviceAccess access_of_callers;
[[maybe_unused]] const std::size_t lag_before = cuda_on_cpu::set_lag(0);
}  // namespace
