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
  square,   ///< a square around the centre as released: no bound, corners may be cut and much listed for nothing
  compact,  ///< tiles that meet the hull with its edges moved outwards by β · (as far as α can reach 1/255)
};

/// How to draw. Defaults are the released method's.
struct ConvexOptions {
  ConvexBox box = ConvexBox::square;
  float beta = 1.0f;  ///< (0,1]; only for the compact box. 1 loses nothing with alpha >= 1/255
  float near_plane = kNearPlane;
  glm::vec3 background{0.0f};
  /// Side of a pixel in those pixels that δ and σ are of: 2 draws a view of half the size as it was at full size.
  float pixel_size = 1.0f;
  /// Evaluates spherical harmonics as the release does by a slip: as if x and y of the centre were its z.
  /// The gradient is that of the true direction, as the release's is.
  bool released_view_direction = false;
};

/// Figures of the last forward pass.
struct ConvexCounts {
  std::size_t visible = 0;       ///< convexes that are listed in at least one tile
  std::size_t tile_entries = 0;  ///< (tile, convex) pairs
};

/// Renders views of convexes and differentiates them.
///
/// Owns the workspace (projected convexes, tile lists) of one view; it grows geometrically and is kept, so a steady
/// loop allocates nothing. backward(), count_flagged() and visible() speak of the last forward() and must get the same
/// convexes, unchanged. Not thread safe; use one a thread of control.
class ConvexRasterizer {
 public:
  explicit ConvexRasterizer(Device device);
  ~ConvexRasterizer();
  ConvexRasterizer(ConvexRasterizer&&) noexcept;
  ConvexRasterizer& operator=(ConvexRasterizer&&) noexcept;

  /// Throws ArgumentError on a contract broken. Not drawn are convexes whose centre is not behind the near plane, with
  /// a point at or behind the camera's plane or more than kMaxConvexReach pixels from the centre, whose points project
  /// to a line, or with anything not finite.
  /// @param color [3,H,W] background added, not clamped
  /// @param alpha [1,H,W] 1 − final transmittance; empty: not wanted
  void forward(const Camera& camera, const Convexes& convexes, const ConvexOptions& options, std::span<float> color,
               std::span<float> alpha = {});

  /// Gradients of every input, through the hull's points and the depth of the centre. The clamp of alpha at 0.99 and of
  /// colour at 0 pass no gradient where they act.
  /// @param color,alpha gradients of the loss with respect to the images; empty means zero
  void backward(const Convexes& convexes, std::span<const float> color, std::span<const float> alpha,
                const ConvexGradients& gradients);

  /// Adds to counts[i] the number of flagged pixels where convex i was blended (paper eq. 9, inner sum), by a replay of
  /// the tile lists: no second projection, no second sort. Exact integers.
  /// @param flagged [H,W], non-zero where flagged
  /// @param counts [N]
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts);

  /// Adds to weights[i] the blending weights α·T of convex i, summed over the pixels where it was blended, in units of
  /// kWeightUnit and rounded a pixel: exact integers. A replay as count_flagged() is.
  /// @param weights [N]
  void add_weights(std::span<std::int32_t> weights);

  /// As Rasterizer::settle().
  bool settle();

  /// [N] non-zero where the last forward() listed the convex in at least one tile. Valid until the next forward().
  std::span<const std::uint8_t> visible() const;

  /// On a GPU this settles and seconds() waits, so call neither in the training loop.
  ConvexCounts counts() const;
  const RasterSeconds& seconds() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Farthest that a projected point may be from the projected centre, pixels (as released).
inline constexpr float kMaxConvexReach = 10000.0f;

}  // namespace splatboost
