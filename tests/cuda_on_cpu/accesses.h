// SPDX-License-Identifier: Apache-2.0
/// @file What was read and written of the device's memory. For the emulator's own files.
#pragma once

#include <cstddef>

namespace cuda_on_cpu {

/// The addresses that memory of the device can have. Called once.
void watch(const std::byte* begin, std::size_t bytes);
/// New memory: nobody wrote it yet.
void forget(const void* memory, std::size_t bytes);

}  // namespace cuda_on_cpu
