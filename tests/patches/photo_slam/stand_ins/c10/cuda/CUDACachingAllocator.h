// SPDX-License-Identifier: Apache-2.0
/// @file What Photo-SLAM uses of libtorch's header of this name, which a libtorch without CUDA lacks.
#pragma once

namespace c10::cuda::CUDACachingAllocator {

inline void emptyCache() {}

}  // namespace c10::cuda::CUDACachingAllocator
