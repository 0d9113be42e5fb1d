// SPDX-License-Identifier: Apache-2.0
#include "tool/sha256.h"

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>

namespace splatboost::patch {
namespace {

constexpr std::size_t kBlock = 64;

/// The first 64 primes, whose roots give the constants.
constexpr std::array<std::uint32_t, 64> primes() {
  std::array<std::uint32_t, 64> found{};
  std::size_t n = 0;
  for (std::uint32_t candidate = 2; n < found.size(); ++candidate) {
    bool prime = true;
    for (std::size_t i = 0; i < n && found[i] * found[i] <= candidate; ++i) prime = prime && candidate % found[i] != 0;
    if (prime) found[n++] = candidate;
  }
  return found;
}

/// First 32 bits of the fractional part of the square (power 2) or cube root (3) of n, by an exact bitwise search.
constexpr std::uint32_t root_fraction(std::uint32_t n, int power) {
  __extension__ using Wide = unsigned __int128;
  std::uint64_t root = 0;  // ⌊n^(1/power)·2³²⌋
  for (int bit = 36; bit >= 0; --bit) {
    const std::uint64_t next = root | (std::uint64_t{1} << bit);
    // Cubes of 37-bit numbers fit into 111 bits.
    const Wide product = power == 2 ? Wide{next} * next : Wide{next} * next * next;
    if (product <= Wide{n} << (32 * power)) root = next;
  }
  return static_cast<std::uint32_t>(root);
}

struct Constants {
  std::array<std::uint32_t, 8> start{};
  std::array<std::uint32_t, 64> rounds{};
};

constexpr Constants make_constants() {
  Constants constants;
  const auto prime = primes();
  for (std::size_t i = 0; i < 8; ++i) constants.start[i] = root_fraction(prime[i], 2);
  for (std::size_t i = 0; i < 64; ++i) constants.rounds[i] = root_fraction(prime[i], 3);
  return constants;
}

constexpr Constants kConstants = make_constants();

void add_block(std::array<std::uint32_t, 8>& state, const unsigned char* block) {
  std::array<std::uint32_t, 64> w{};
  for (std::size_t i = 0; i < 16; ++i) {
    w[i] = std::uint32_t{block[4 * i]} << 24 | std::uint32_t{block[4 * i + 1]} << 16 |
           std::uint32_t{block[4 * i + 2]} << 8 | std::uint32_t{block[4 * i + 3]};
  }
  for (std::size_t i = 16; i < 64; ++i) {
    const std::uint32_t a = w[i - 15], b = w[i - 2];
    w[i] = w[i - 16] + (std::rotr(a, 7) ^ std::rotr(a, 18) ^ (a >> 3)) + w[i - 7] +
           (std::rotr(b, 17) ^ std::rotr(b, 19) ^ (b >> 10));
  }
  auto [a, b, c, d, e, f, g, h] = state;
  for (std::size_t i = 0; i < 64; ++i) {
    const std::uint32_t t1 = h + (std::rotr(e, 6) ^ std::rotr(e, 11) ^ std::rotr(e, 25)) + ((e & f) ^ (~e & g)) +
                             kConstants.rounds[i] + w[i];
    const std::uint32_t t2 = (std::rotr(a, 2) ^ std::rotr(a, 13) ^ std::rotr(a, 22)) + ((a & b) ^ (a & c) ^ (b & c));
    h = g, g = f, f = e, e = d + t1, d = c, c = b, b = a, a = t1 + t2;
  }
  const std::array<std::uint32_t, 8> add = {a, b, c, d, e, f, g, h};
  for (std::size_t i = 0; i < 8; ++i) state[i] += add[i];
}

}  // namespace

std::string sha256(std::string_view bytes) {
  std::string padded(bytes);
  padded += static_cast<char>(0x80);
  while (padded.size() % kBlock != kBlock - 8) padded += '\0';
  const std::uint64_t bits = std::uint64_t{bytes.size()} * 8;
  for (int shift = 56; shift >= 0; shift -= 8) padded += static_cast<char>(bits >> shift & 0xff);

  std::array<std::uint32_t, 8> state = kConstants.start;
  for (std::size_t at = 0; at < padded.size(); at += kBlock) {
    add_block(state, reinterpret_cast<const unsigned char*>(padded.data() + at));
  }
  std::string digits;
  for (const std::uint32_t word : state) {
    char text[9];
    std::snprintf(text, sizeof text, "%08x", word);
    digits += text;
  }
  return digits;
}

}  // namespace splatboost::patch
