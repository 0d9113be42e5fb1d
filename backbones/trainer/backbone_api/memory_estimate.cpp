// SPDX-License-Identifier: Apache-2.0
#include "trainer/backbone_api/memory_estimate.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace splatboost {
namespace {

constexpr std::size_t kFloat = sizeof(float);

// A Gaussian of degree-3 spherical harmonics.
constexpr std::size_t kParameters = 3 + 3 + 45 + 1 + 3 + 4;
constexpr std::size_t kTrained = 4 * kParameters * kFloat;     // values, gradients, two moments
constexpr std::size_t kActivated = 4 * kFloat;                 // scales, opacity
constexpr std::size_t kStatistics = (2 + 2 + 3 + 4) * kFloat;  // screen gradients, their sums, means, clearances
constexpr std::size_t kScores = 2 * 8 + 8 + 4 + 4;             // sums over views, importance, pruning score, counts
constexpr std::size_t kProjected = 64 + 8 + 9;                 // blend record, listing, small arrays
// (tile, Gaussian) pairs per Gaussian. In photo scenes: 3 (small images) to 20 (half a megapixel) with the 3σ square, 2
// to 7 with the compact box, where runs need the rest for scores.
constexpr std::size_t kEntries = 10;
constexpr std::size_t kEntry = 4 + 4 + 8 + 8 + 4 + 64;  // listing, slot, key, list, rows, sums
// Averages at the end of a run. Growth needs less: it copies one tensor at a time.
constexpr std::size_t kAverages = kParameters * kFloat;

// Bytes per pixel: image and its gradient; blended tiles; error and mask of a scored view.
constexpr std::size_t kPixel = (3 + 3 + 4) * kFloat + kFloat + 1;

double mebibytes(std::uint64_t bytes) { return static_cast<double>(bytes) / (1024.0 * 1024.0); }

/// "312 MiB", "1.6 GiB"
std::string size_text(std::uint64_t bytes) {
  std::ostringstream text;
  const double mib = mebibytes(bytes);
  if (mib < 1024) {
    text << std::lround(mib) << " MiB";
  } else {
    text.precision(1);
    text << std::fixed << mib / 1024 << " GiB";
  }
  return text.str();
}

std::string count_text(std::size_t count) {
  std::string digits = std::to_string(count);
  for (std::size_t at = digits.size(); at > 3; at -= 3) digits.insert(at - 3, ",");
  return digits;
}

}  // namespace

std::size_t drawn_memory_bytes() { return kProjected + kEntries * kEntry; }

std::size_t gaussian_memory_bytes() {
  return kTrained + kActivated + kStatistics + kScores + drawn_memory_bytes() + kAverages;
}

std::size_t pixel_memory_bytes() { return kPixel; }

MemoryEstimate estimate_memory(const Scene& scene, std::uint64_t resident_bytes, std::size_t bytes_per_primitive,
                               std::size_t bytes_per_pixel) {
  MemoryEstimate estimate;
  std::size_t largest = 0;
  for (const auto* views : {&scene.train, &scene.train_halves, &scene.test}) {
    for (const View& view : *views) {
      estimate.photo_bytes += view.color.size() + view.valid.size();
      largest = std::max(largest, view.color.size() / 3);
    }
  }
  std::size_t rescaled = 0;  // read after resident_bytes was measured
  for (const View& view : scene.train_rescaled) rescaled += view.color.size() + view.valid.size();
  estimate.fixed_bytes = std::max(resident_bytes, estimate.photo_bytes) + rescaled + bytes_per_pixel * largest;
  estimate.photo_bytes += rescaled;
  estimate.bytes_per_primitive = bytes_per_primitive;
  return estimate;
}

std::string memory_text(const MemoryEstimate& estimate, std::size_t primitives, std::size_t cap) {
  std::string text = "memory: about " + size_text(estimate.bytes(primitives)) + " at the start (photos " +
                     size_text(estimate.photo_bytes) + "), " + size_text(100000 * estimate.bytes_per_primitive) +
                     " more per 100,000 primitives";
  if (cap > 0) text += "; " + size_text(estimate.bytes(cap)) + " at " + count_text(cap);
  return text;
}

std::optional<std::string> memory_warning(const MemoryEstimate& estimate, std::size_t primitives, std::size_t cap,
                                          std::uint64_t resident_bytes, std::uint64_t free_bytes) {
  const std::uint64_t room = resident_bytes + free_bytes;
  const std::size_t expected = std::max(primitives, cap);
  if (free_bytes == 0 || estimate.bytes(expected) <= room) return std::nullopt;
  return "warning: about " + size_text(estimate.bytes(expected)) + " are needed for " + count_text(expected) +
         " primitives, " + size_text(room) + " are free; use -r 2 or a lower --max-primitives";
}

}  // namespace splatboost
