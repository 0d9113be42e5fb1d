// SPDX-License-Identifier: Apache-2.0
/// @file Reference rasterizer of smooth convexes in double precision, simple and slow, written from the formulas of 3D
/// Convex Splatting. Like reference/rasterizer.h it does not depend on the core and is templated on the scalar.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "reference/rasterizer.h"

namespace splatboost::reference {

struct ConvexOptions {
  bool compact = false;  ///< the exact bound; otherwise the square of the released code
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
  /// [H,W] non-zero where single precision may decide differently at a threshold of this pixel.
  std::vector<std::uint8_t> uncertain;
  std::vector<std::uint8_t> visible;            ///< [N] listed in at least one tile
  std::vector<std::uint8_t> listing_uncertain;  ///< [N] single precision may decide differently whether a tile lists it
  std::size_t tile_entries = 0;                 ///< (tile, convex) pairs
  std::size_t uncertain_entries = 0;
};

template <class Scalar>
ConvexRendering<Scalar> render(const ConvexScene<Scalar>& scene, const Camera& camera, const ConvexOptions& options,
                               const BlendObserver& blended = {});

/// [N] number of flagged pixels in which each convex is blended.
std::vector<std::int64_t> count_flagged(const ConvexScene<double>& scene, const Camera& camera,
                                        const ConvexOptions& options, const std::vector<std::uint8_t>& flagged);

/// [N] blending weights α·T of each convex, rounded to 1/256 per pixel and summed over the pixels, in that unit.
/// @param certain [N] receives 0 where rounding of a weight may go either way
std::vector<std::int64_t> blending_weights(const ConvexScene<double>& scene, const Camera& camera,
                                           const ConvexOptions& options, std::vector<std::uint8_t>& certain);

/// dL/d image; both are required.
struct ConvexImageGradients {
  std::vector<double> color, alpha;
};

/// Derivative of L = Σ image · image gradient with respect to every element of an input.
Gradient gradient(const ConvexScene<double>& scene, const Camera& camera, const ConvexOptions& options,
                  const ConvexImageGradients& image_gradients, ConvexInput input);

/// The value of L.
double objective(const ConvexScene<double>& scene, const Camera& camera, const ConvexOptions& options,
                 const ConvexImageGradients& image_gradients);

}  // namespace splatboost::reference
