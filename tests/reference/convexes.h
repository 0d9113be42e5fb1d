// SPDX-License-Identifier: Apache-2.0
/// @file The slow, obvious rasterizer of smooth convexes in double precision, written from the formulas of 3D Convex
/// Splatting. Like reference/rasterizer.h it depends on nothing of the core, and is templated on the scalar.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "reference/rasterizer.h"

namespace splatboost::reference {

struct ConvexOptions {
  bool compact = false;  ///< the exact bound; otherwise the released square
  double beta = 1;
  double near_plane = 0.2f;
  std::array<double, 3> background{};
  double pixel_size = 1;
  bool released_view_direction = false;
};

/// The inputs of a rendering, each differentiable.
template <class Scalar>
struct ConvexScene {
  std::size_t count = 0;
  std::size_t points_per_convex = 6;
  std::vector<Scalar> points;      ///< [N,K,3]
  std::vector<Scalar> smoothness;  ///< [N]
  std::vector<Scalar> sharpness;   ///< [N]
  std::vector<Scalar> opacities;   ///< [N]
  std::vector<Scalar> sh_dc;       ///< [N,3]
  std::vector<Scalar> sh_rest;     ///< [N,sh_rest_rows,3]
  int sh_rest_rows = 0;
  int sh_degree = 0;
  std::vector<Scalar> colors;  ///< [N,3]; used where sh_dc is empty
};

/// Names a field of ConvexScene.
enum class ConvexInput { points, smoothness, sharpness, opacities, sh_dc, sh_rest, colors };

template <class Scalar>
std::vector<Scalar>& field(ConvexScene<Scalar>& scene, ConvexInput input);

template <class Scalar>
struct ConvexRendering {
  std::vector<Scalar> color;  ///< [3,H,W]
  std::vector<Scalar> alpha;  ///< [H,W]
  /// [H,W] non-zero where a decision of this pixel is so close that single precision may decide otherwise.
  std::vector<std::uint8_t> uncertain;
  std::vector<std::uint8_t> visible;            ///< [N] listed in a tile
  std::vector<std::uint8_t> listing_uncertain;  ///< [N] whether a tile lists it may be decided otherwise
  std::size_t tile_entries = 0;                 ///< (tile, convex) pairs
  std::size_t uncertain_entries = 0;
};

template <class Scalar>
ConvexRendering<Scalar> render(const ConvexScene<Scalar>& scene, const Camera& camera, const ConvexOptions& options,
                               const BlendObserver& blended = {});

/// Number of flagged pixels where each convex is blended.
std::vector<std::int64_t> count_flagged(const ConvexScene<double>& scene, const Camera& camera,
                                        const ConvexOptions& options, const std::vector<std::uint8_t>& flagged);

/// Blending weights α·T of each convex, in 1/256 and rounded a pixel.
/// @param certain [N] 0 where a rounding may go the other way
std::vector<std::int64_t> blending_weights(const ConvexScene<double>& scene, const Camera& camera,
                                           const ConvexOptions& options, std::vector<std::uint8_t>& certain);

/// dL/d image, both required.
struct ConvexImageGradients {
  std::vector<double> color, alpha;
};

/// Derivative of L = Σ image · image gradient with respect to every element of an input.
Gradient gradient(const ConvexScene<double>& scene, const Camera& camera, const ConvexOptions& options,
                  const ConvexImageGradients& image_gradients, ConvexInput input);

/// L itself.
double objective(const ConvexScene<double>& scene, const Camera& camera, const ConvexOptions& options,
                 const ConvexImageGradients& image_gradients);

}  // namespace splatboost::reference
