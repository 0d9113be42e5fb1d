// SPDX-License-Identifier: Apache-2.0
/// @file The checksum of packed scenes and checkpoints. It finds damage; it is no protection against intent.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace splatboost {

/// Starts as the number of bytes plus `before`. Each 64-bit little-endian word, the last filled up with zeros, is xored
/// in; the sum is then multiplied by 0x9e3779b97f4a7c15 and rotated left by 29 bits. Any change of one word changes it.
/// @param before checksum of what comes before, to chain several blocks
std::uint64_t checksum(std::span<const std::byte> bytes, std::uint64_t before = 0);

}  // namespace splatboost
