// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/checksum.h"

#include <algorithm>
#include <bit>
#include <cstring>

namespace splatboost {

static_assert(std::endian::native == std::endian::little, "words are read as they lie in memory");

std::uint64_t checksum(std::span<const std::byte> bytes, std::uint64_t before) {
  constexpr std::uint64_t kFactor = 0x9e3779b97f4a7c15u;  // odd, hence invertible modulo 2^64
  std::uint64_t sum = bytes.size() + before;
  for (std::size_t at = 0; at < bytes.size(); at += sizeof sum) {
    std::uint64_t word = 0;
    std::memcpy(&word, bytes.data() + at, std::min(sizeof word, bytes.size() - at));
    sum = std::rotl((sum ^ word) * kFactor, 29);
  }
  return sum;
}

}  // namespace splatboost
