// SPDX-License-Identifier: Apache-2.0
/// @file How much memory a run will take, told before it starts.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "trainer/dataset/scene.h"

namespace splatboost {

/// What a Gaussian takes while it trains, in bytes: its parameters with gradients and moments, its statistics, and its
/// share of the rasterizer's workspace. About: how many tiles a Gaussian meets depends on the scene.
std::size_t gaussian_memory_bytes();

/// The rasterizer's share of that.
std::size_t drawn_memory_bytes();

struct MemoryEstimate {
  std::uint64_t fixed_bytes = 0;  ///< whatever the number of primitives: the program, photos, images
  std::uint64_t photo_bytes = 0;  ///< of those, the photos
  std::uint64_t bytes_per_primitive = 0;

  std::uint64_t bytes(std::size_t primitives) const { return fixed_bytes + bytes_per_primitive * primitives; }
};

/// Peak resident memory of a training run on this scene.
/// @param resident_bytes what the process holds with the scene read and the backbone not yet made
/// @param bytes_per_primitive Backbone::bytes_per_primitive()
MemoryEstimate estimate_memory(const Scene& scene, std::uint64_t resident_bytes, std::size_t bytes_per_primitive);

/// One line for the user: memory at the start, growth, and the end where a cap (0: none) says what that is.
std::string memory_text(const MemoryEstimate& estimate, std::size_t primitives, std::size_t cap);

/// A line if the start, or the cap, does not fit into what the process holds plus what is free.
/// @param free_bytes 0: not known
std::optional<std::string> memory_warning(const MemoryEstimate& estimate, std::size_t primitives, std::size_t cap,
                                          std::uint64_t resident_bytes, std::uint64_t free_bytes);

}  // namespace splatboost
