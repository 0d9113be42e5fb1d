// SPDX-License-Identifier: Apache-2.0
/// @file Tracks reads and writes of device memory. Internal to the emulator.
#pragma once

#include <cstddef>

namespace cuda_on_cpu {

/// Sets the address range of device memory. Called once.
void watch(const std::byte* begin, std::size_t bytes);
/// Marks memory as unwritten.
void forget(const void* memory, std::size_t bytes);

}  // namespace cuda_on_cpu
