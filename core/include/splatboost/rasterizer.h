// SPDX-License-Identifier: Apache-2.0
/// @file The differentiable rasterizer: project → tile lists → blend, its gradient, and the count replay.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include <glm/vec3.hpp>

#include "splatboost/camera.h"
#include "splatboost/constants.h"
#include "splatboost/device.h"
#include "splatboost/gaussians.h"

namespace splatboost {

/// Which tiles a splat is listed in.
enum class BoxPolicy {
  square,   ///< all tiles of the 3σ square of 3DGS: the baseline
  ellipse,  ///< tiles that the ellipse A(p) <= β·2·ln(σ/τ_α) meets: the compact box, paper eq. 15
};

/// How to draw. Defaults are 3DGS as published.
struct RasterOptions {
  BoxPolicy box = BoxPolicy::square;
  float beta = 1.0f;                ///< (0,1]; only for the ellipse. 1 keeps every pixel with alpha >= 1/255
  float low_pass = kLowPass;        ///< px², >= 0; added to the variance of both axes
  bool compensate_opacity = false;  ///< opacity × sqrt(det Σ / det(Σ + low-pass))
  float near_plane = kNearPlane;    ///< world units, > 0
  glm::vec3 background{0.0f};
};

/// Outputs of a forward pass: planar images of the camera's size. An empty span is not computed.
struct RasterImages {
  std::span<float> color;          ///< [3,H,W] background added, not clamped
  std::span<float> features;       ///< [F,H,W], F = features_per_gaussian; the background is zero
  std::span<float> inverse_depth;  ///< [1,H,W] Σ wᵢ / zᵢ
  std::span<float> alpha;          ///< [1,H,W] 1 − final transmittance
};

/// Gradients of the loss with respect to the images; empty means zero. Where no splat was blended (alpha 0) they are
/// not used and may have any value, also NaN.
struct RasterImageGradients {
  std::span<const float> color;
  std::span<const float> features;
  std::span<const float> inverse_depth;
  std::span<const float> alpha;
};

/// Counts of the last forward pass.
struct RasterCounts {
  std::size_t visible = 0;       ///< Gaussians that are listed in at least one tile
  std::size_t tile_entries = 0;  ///< (tile, Gaussian) pairs
};

/// Unit of add_weights(): a weight below half of it is invisible in an 8-bit image. Sums over a view of up to
/// 8 megapixels fit 32 bits.
inline constexpr float kWeightUnit = 1.0f / 256;

/// Time in seconds of each stage of the last forward(), backward(), and replay: counts or weights.
struct RasterSeconds {
  double project = 0;
  double tile_lists = 0;  ///< depth sort and binning
  double blend = 0;
  double blend_backward = 0;
  double project_backward = 0;
  double count = 0;
};

/// Renders views of Gaussians and differentiates them.
///
/// Owns the workspace (projected splats, tile lists) of one view; it grows geometrically and is kept, so a steady
/// loop allocates nothing. backward(), the counts, visible() and screen_radii() refer to the last forward(),
/// whose Gaussians must be unchanged. Not thread-safe; use one per calling thread.
class Rasterizer {
 public:
  explicit Rasterizer(Device device);
  ~Rasterizer();
  Rasterizer(Rasterizer&&) noexcept;
  Rasterizer& operator=(Rasterizer&&) noexcept;

  /// Throws ArgumentError if an argument is invalid, or if the image has more than 2^20 pixels per side or 2^24 tiles
  /// of 16 × 16 pixels. Gaussians whose projection or opacity is not finite, degenerate or overflows are not drawn. If
  /// drawing throws (too little memory), backward() and the counts need another forward().
  void forward(const Camera& camera, const Gaussians& gaussians, const RasterOptions& options,
               const RasterImages& images);

  /// Gradients with respect to every input. No gradient passes where alpha is clamped at 0.99 or a colour at 0.
  void backward(const Gaussians& gaussians, const RasterImageGradients& image_gradients,
                const GaussianGradients& gradients);

  /// Adds to counts[i] the number of flagged pixels where Gaussian i was blended (paper eq. 9, inner sum). Replays the
  /// tile lists, without projecting or sorting again. The counts are exact.
  /// @param flagged [H,W], non-zero where flagged
  /// @param counts [N]
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts);

  /// Adds to counts[i] the number of pixels where Gaussian i was blended while the transmittance in front of it was
  /// above `min_transmittance`: how many pixels observe it (PGSR: 0.5). Replays the tile lists like count_flagged(),
  /// but leaves a tile once no transmittance in it is above the limit.
  /// @param counts [N]
  void count_observed(float min_transmittance, std::span<std::int32_t> counts);

  /// Adds to weights[i] the blending weights α·T of Gaussian i, summed over the pixels where it was blended, in units
  /// of kWeightUnit and rounded per pixel, so that sums are exact. A sum stops at 2^31 - 1, which only a Gaussian that
  /// covers more than 8 megapixels alone reaches. Replays the tile lists like count_flagged().
  /// @param weights [N]
  void add_weights(std::span<std::int32_t> weights);

  /// On a GPU forward() does not wait to learn the size of the tile lists: it allocates by the sizes of earlier frames,
  /// plus up to half as much. A view that needs more is drawn without some of its splats. settle() waits for the last
  /// forward() and, if that happened, draws it again into the same images, which must still exist, as must the
  /// Gaussians. Call it where every splat counts (scores, evaluation), not in a training loop, whose next forward()
  /// allocates more by itself. If it throws, it may be called again; until it succeeds, backward() and the counts
  /// refuse.
  /// @return whether the view was drawn again; always false on the CPU
  bool settle();

  /// [N] non-zero where the last forward() listed the Gaussian in at least one tile. Valid until the next forward().
  std::span<const std::uint8_t> visible() const;

  /// [N] 3σ radius on screen in pixels, rounded up; 0 where not visible. Valid until the next forward().
  std::span<const std::int32_t> screen_radii() const;

  /// On a GPU counts() settles and seconds() waits, so call neither in the training loop.
  RasterCounts counts() const;
  const RasterSeconds& seconds() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost
