// SPDX-License-Identifier: Apache-2.0
/// @file The points of convexes: how they begin, how they are shared out to children, and how large they are.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace splatboost {

/// Points of a convex, and children of one that splits.
inline constexpr std::size_t kConvexPoints = 6;
inline constexpr std::size_t kConvexWidth = 3 * kConvexPoints;

/// Six points on a sphere about each centre by the golden angle, from pole to pole.
/// @param centres [N,3] @param radii [N] @return [N,6,3]
std::vector<float> spheres(std::span<const float> centres, std::span<const float> radii);

/// Child number `child`: the parent's shape × size, its centre moved to the parent's point of that number.
/// @param parent [6,3] @param to [6,3]
void child_points(std::span<const float> parent, std::size_t child, float size, std::span<float> to);

/// Means of the points: [N,3]
std::vector<float> convex_centres(std::span<const float> points);

/// Longest of the standard deviations of a convex's points along the axes of the world: [N]
void longest_deviations(std::span<const float> points, std::span<float> longest);

}  // namespace splatboost
