// SPDX-License-Identifier: Apache-2.0
/// @file The parts of libtorch's header of this name that Photo-SLAM uses; libtorch without CUDA lacks it.
#pragma once

namespace c10::cuda::CUDACachingAllocator {

inline void emptyCache() {}

}  // namespace c10::cuda::CUDACachingAllocator
