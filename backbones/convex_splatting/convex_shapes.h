// SPDX-License-Identifier: Apache-2.0
/// @file The points of convexes: initialisation, splitting and size.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace splatboost {

/// Number of points of a convex, and of its children when it splits.
inline constexpr std::size_t kConvexPoints = 6;
inline constexpr std::size_t kConvexWidth = 3 * kConvexPoints;

/// Six points on a sphere around each centre, spaced by the golden angle from pole to pole.
/// @param centres [N,3] @param radii [N] @return [N,6,3]
std::vector<float> spheres(std::span<const float> centres, std::span<const float> radii);

/// Points of child `child`: the parent's shape scaled by `size`, with its centre at the parent's point `child`.
/// @param parent [6,3] @param to [6,3]
void child_points(std::span<const float> parent, std::size_t child, float size, std::span<float> to);

/// Means of the points: [N,3]
std::vector<float> convex_centres(std::span<const float> points);

/// Largest standard deviation of each convex's points along the world axes: [N]
void longest_deviations(std::span<const float> points, std::span<float> longest);

}  // namespace splatboost
