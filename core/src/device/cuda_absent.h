// SPDX-License-Identifier: Apache-2.0
/// @file The error of a build without CUDA when CUDA is requested.
#pragma once

#include "splatboost/errors.h"

namespace splatboost {

[[noreturn]] inline void absent() {
  throw NoDeviceError("this build of SplatBoost has no CUDA: build it where nvcc is installed");
}

}  // namespace splatboost
