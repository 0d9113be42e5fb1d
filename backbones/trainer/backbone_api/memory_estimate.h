// SPDX-License-Identifier: Apache-2.0
/// @file Estimate of the memory of a training run, printed before it starts.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "trainer/dataset/scene.h"

namespace splatboost {

/// Approximate bytes per Gaussian during training: its parameters with gradients and moments, its statistics, and its
/// share of the rasterizer's workspace. The number of tiles per Gaussian depends on the scene.
std::size_t gaussian_memory_bytes();

/// The rasterizer's share of gaussian_memory_bytes().
std::size_t drawn_memory_bytes();

/// Approximate bytes per pixel of a view that is trained on: the image, its gradient and the rasterizer's tiles.
std::size_t pixel_memory_bytes();

struct MemoryEstimate {
  std::uint64_t fixed_bytes = 0;  ///< independent of the number of primitives: the program, photos, images
  std::uint64_t photo_bytes = 0;  ///< of those, the photos
  std::uint64_t bytes_per_primitive = 0;

  std::uint64_t bytes(std::size_t primitives) const { return fixed_bytes + bytes_per_primitive * primitives; }
};

/// Peak resident memory of a training run on this scene.
/// @param resident_bytes resident memory after the scene is read and before the backbone is created
/// @param bytes_per_primitive Backbone::bytes_per_primitive()
/// @param bytes_per_pixel Backbone::bytes_per_pixel(), of the largest view
MemoryEstimate estimate_memory(const Scene& scene, std::uint64_t resident_bytes, std::size_t bytes_per_primitive,
                               std::size_t bytes_per_pixel);

/// One line for the user: memory at the start, its growth with the primitives, and memory at the cap (0: no cap).
std::string memory_text(const MemoryEstimate& estimate, std::size_t primitives, std::size_t cap);

/// A warning if the memory at the start, or at the cap, exceeds what the process holds plus what is free.
/// @param free_bytes 0: unknown
std::optional<std::string> memory_warning(const MemoryEstimate& estimate, std::size_t primitives, std::size_t cap,
                                          std::uint64_t resident_bytes, std::uint64_t free_bytes);

}  // namespace splatboost
