// SPDX-License-Identifier: Apache-2.0
/// @file The operations on a CUDA device, as the public functions call them, which have checked the arguments. Each is
/// defined in the .cu file of its name; a build without CUDA has cuda_absent.cpp in their place.
#pragma once

#include "splatboost/cuda_stream.h"

namespace splatboost::cuda {}  // namespace splatboost::cuda
