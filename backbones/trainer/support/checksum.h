// SPDX-License-Identifier: Apache-2.0
/// @file The checksum of packed scenes and checkpoints. It detects damage, not deliberate changes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace splatboost {

/// Starts as the number of bytes plus `before`. For each 64-bit little-endian word (the last padded with zeros), the
/// word is xored in, then the sum is multiplied by 0x9e3779b97f4a7c15 and rotated left by 29 bits. Any change of one
/// word changes the sum.
/// @param before checksum of the preceding blocks, to chain several blocks
std::uint64_t checksum(std::span<const std::byte> bytes, std::uint64_t before = 0);

}  // namespace splatboost
