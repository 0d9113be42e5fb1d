// SPDX-License-Identifier: Apache-2.0
/// @file The differentiable rasterizer of smooth convexes: project → tile lists → blend, its gradient, and the count
/// replay. The counterpart of rasterizer.h.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include <glm/vec3.hpp>

#include "splatboost/camera.h"
#include "splatboost/constants.h"
#include "splatboost/convexes.h"
#include "splatboost/device.h"
#include "splatboost/rasterizer.h"

namespace splatboost {

/// Which tiles a convex is listed in.
enum class ConvexBox {
  square,   ///< the released square around the centre; no bound: it may cut corners and list tiles that are not reached
  compact,  ///< tiles that meet the hull, its edges moved outwards by β · (the distance where α can reach 1/255)
};

/// How to draw. Defaults are the released method's.
struct ConvexOptions {
  ConvexBox box = ConvexBox::square;
  float beta = 1.0f;              ///< (0,1]; only for the compact box. 1 keeps every pixel with alpha >= 1/255
  float near_plane = kNearPlane;  ///< world units, > 0
  glm::vec3 background{0.0f};
  /// Side of a pixel, in the pixels that δ and σ refer to: 2 draws a view of half the size as at full size.
  float pixel_size = 1.0f;
  /// Reproduces a mistake of the release: evaluates spherical harmonics as if x and y of the centre were its z.
  /// The gradient is that of the true direction, as in the release.
  bool released_view_direction = false;
};

/// Counts of the last forward pass.
struct ConvexCounts {
  std::size_t visible = 0;       ///< convexes that are listed in at least one tile
  std::size_t tile_entries = 0;  ///< (tile, convex) pairs
};

/// Renders views of convexes and differentiates them.
///
/// Owns the workspace (projected convexes, tile lists) of one view; it grows geometrically and is kept, so a steady
/// loop allocates nothing. backward(), count_flagged(), add_weights() and visible() refer to the last forward(), whose
/// convexes must be unchanged. Not thread-safe; use one per calling thread.
class ConvexRasterizer {
 public:
  explicit ConvexRasterizer(Device device);
  ~ConvexRasterizer();
  ConvexRasterizer(ConvexRasterizer&&) noexcept;
  ConvexRasterizer& operator=(ConvexRasterizer&&) noexcept;

  /// Throws ArgumentError if an argument is invalid, and for images as large as Rasterizer refuses them. A convex is
  /// not drawn if its centre is not beyond the near plane, if one of its points is at or behind the camera's plane or
  /// at least kMaxConvexReach pixels from the centre, if its points project to a line, or if any value is not finite.
  /// If drawing throws (too little memory), backward() and the counts need another forward().
  /// @param color [3,H,W] background added, not clamped
  /// @param alpha [1,H,W] 1 − final transmittance; empty: not wanted
  void forward(const Camera& camera, const Convexes& convexes, const ConvexOptions& options, std::span<float> color,
               std::span<float> alpha = {});

  /// Gradients with respect to every input, through the hull's points and the depth of the centre. No gradient passes
  /// where alpha is clamped at 0.99 or a colour at 0.
  /// @param color,alpha gradients of the loss with respect to the images; empty means zero. Where no convex was blended
  /// (alpha 0) they are not used and may have any value, also NaN.
  void backward(const Convexes& convexes, std::span<const float> color, std::span<const float> alpha,
                const ConvexGradients& gradients);

  /// Adds to counts[i] the number of flagged pixels where convex i was blended (paper eq. 9, inner sum), by replaying
  /// the tile lists, without projecting or sorting again. The counts are exact.
  /// @param flagged [H,W], non-zero where flagged
  /// @param counts [N]
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts);

  /// Adds to weights[i] the blending weights α·T of convex i, summed over the pixels where it was blended, in units of
  /// kWeightUnit and rounded per pixel, so that sums are exact, and stop at 2^31 - 1. Replays the tile lists like
  /// count_flagged().
  /// @param weights [N]
  void add_weights(std::span<std::int32_t> weights);

  /// As Rasterizer::settle(). Never redraws: on a GPU forward() waits for the size of the tile lists.
  bool settle();

  /// [N] non-zero where the last forward() listed the convex in at least one tile. Valid until the next forward().
  std::span<const std::uint8_t> visible() const;

  /// On a GPU both wait, so call neither in the training loop.
  ConvexCounts counts() const;
  const RasterSeconds& seconds() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Largest distance of a projected point from the projected centre, pixels (as released).
inline constexpr float kMaxConvexReach = 10000.0f;

}  // namespace splatboost
