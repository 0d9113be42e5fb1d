// SPDX-License-Identifier: Apache-2.0
/// @file Reference rasterizer in double precision, simple and slow ("witness" in the names of tests).
///
/// It does not depend on the core. It is written from the formulas of 3D Gaussian Splatting (EWA splatting with an
/// affine projection, front-to-back alpha blending) and is templated on the scalar: with dual numbers it computes exact
/// derivatives of the same code.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "reference/dual.h"

namespace splatboost::reference {

// The model's constants, repeated on purpose: a reference that uses the core's constants would not notice if they
// change. The model is defined with the floats nearest to these decimals.
inline constexpr int kTile = 16;
inline constexpr double kAlphaFloor = 1.0f / 255.0f;
inline constexpr double kAlphaCeiling = 0.99f;
inline constexpr double kTransmittanceFloor = 1e-4f;
inline constexpr double kFieldMargin = 1.3f;
inline constexpr double kCompensation2Floor = 2.5e-5f;
inline constexpr double kShortestQuaternion = 1e-18f;
inline constexpr double kLongestQuaternion = 1e19f;
/// Pixels by which an implementation may widen an ellipse, so that rounding does not lose tiles. Tiles that only the
/// widened ellipse intersects count as uncertain; tiles that the ellipse itself intersects do not.
inline constexpr double kTileSlack = 1.1e-3;

/// Pinhole camera in COLMAP's frame; pixel (i, j) has its centre at (i + 0.5, j + 0.5).
struct Camera {
  int width = 0;
  int height = 0;
  double fx = 0;
  double fy = 0;
  double cx = 0;
  double cy = 0;
  std::array<std::array<double, 3>, 3> rotation{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};  ///< rows; camera from world
  std::array<double, 3> translation{};

  int tiles_x() const { return (width + kTile - 1) / kTile; }
  int tiles_y() const { return (height + kTile - 1) / kTile; }
};

struct Options {
  bool ellipse = false;  ///< compact box; otherwise the 3σ square
  double beta = 1;
  double low_pass = 0.3f;
  bool compensate_opacity = false;
  double near_plane = 0.2f;
  std::array<double, 3> background{};
};

/// The inputs of a rendering, each differentiable.
template <class Scalar>
struct Scene {
  std::size_t count = 0;
  std::vector<Scalar> means;        ///< [N,3]
  std::vector<Scalar> scales;       ///< [N,3], with rotations
  std::vector<Scalar> rotations;    ///< [N,4] w x y z
  std::vector<Scalar> covariances;  ///< [N,6] xx xy xz yy yz zz; used where scales are empty
  std::vector<Scalar> opacities;    ///< [N]
  std::vector<Scalar> sh_dc;        ///< [N,3]
  std::vector<Scalar> sh_rest;      ///< [N,sh_rest_rows,3]
  int sh_rest_rows = 0;
  int sh_degree = 0;
  std::vector<Scalar> colors;    ///< [N,3]; used where sh_dc is empty
  std::vector<Scalar> features;  ///< [N,features_per_gaussian]
  int features_per_gaussian = 0;
  /// [N,2] added to the projected means. Zero; present only so that the gradient of the screen means can be computed.
  std::vector<Scalar> screen_means;
};

/// Names a field of Scene.
enum class Input { means, scales, rotations, covariances, opacities, sh_dc, sh_rest, colors, features, screen_means };

template <class Scalar>
std::vector<Scalar>& field(Scene<Scalar>& scene, Input input);

/// A projected Gaussian.
template <class Scalar>
struct Splat {
  bool drawn = false;
  Scalar x, y;   ///< mean on the image, pixels
  Scalar depth;  ///< along the view axis
  Scalar conic_xx, conic_xy, conic_yy;
  Scalar opacity;  ///< compensated if Options::compensate_opacity
  std::array<Scalar, 3> color;
  int radius = 0;      ///< of the 3σ square, pixels
  int radius_low = 0;  ///< bounds of the radius under single-precision rounding
  int radius_high = 0;
  double condition = 1;  ///< condition number of the screen covariance: how much its inversion amplifies rounding
  double conic_norm = 0;
  bool uncertain =
      false;  ///< within rounding of a threshold of the projection (near plane, field of view, colour 0, compensation)
};

template <class Scalar>
Splat<Scalar> project(const Scene<Scalar>& scene, std::size_t index, const Camera& camera, const Options& options);

/// Whether a tile lists a splat.
struct TileListing {
  bool listed = false;
  bool uncertain = false;  ///< single-precision rounding may give the opposite result
};

template <class Scalar>
TileListing tile_lists(const Splat<Scalar>& splat, int tile_x, int tile_y, const Camera& camera,
                       const Options& options);

/// Smallest value of dᵀ conic d over the closed rectangle [x0,x1]×[y0,y1], d = point − (x, y).
double smallest_in_rectangle(double conic_xx, double conic_xy, double conic_yy, double x, double y, double x0,
                             double x1, double y0, double y1);

template <class Scalar>
struct Rendering {
  std::vector<Scalar> color;          ///< [3,H,W]
  std::vector<Scalar> features;       ///< [F,H,W]
  std::vector<Scalar> inverse_depth;  ///< [H,W]
  std::vector<Scalar> alpha;          ///< [H,W]
  /// [H,W] non-zero where single precision may decide differently at this pixel (alpha against 1/255 or 0.99,
  /// transmittance against 1e-4, order of depths, listed in the tile).
  std::vector<std::uint8_t> uncertain;
  std::vector<std::uint8_t> visible;            ///< [N] listed in at least one tile
  std::vector<std::uint8_t> listing_uncertain;  ///< [N] single precision may decide differently whether a tile lists it
  std::vector<int> radii;                       ///< [N] 0 where not visible
  std::vector<int> radii_low;                   ///< [N] bounds of the radius under rounding
  std::vector<int> radii_high;
  std::size_t tile_entries = 0;  ///< (tile, Gaussian) pairs
  std::size_t uncertain_entries = 0;
};

/// Called for each splat blended in each pixel. The weight is α·T.
using BlendObserver = std::function<void(std::size_t pixel, std::size_t gaussian, double weight)>;

template <class Scalar>
Rendering<Scalar> render(const Scene<Scalar>& scene, const Camera& camera, const Options& options,
                         const BlendObserver& blended = {});

/// [N] number of flagged pixels in which each Gaussian is blended.
std::vector<std::int64_t> count_flagged(const Scene<double>& scene, const Camera& camera, const Options& options,
                                        const std::vector<std::uint8_t>& flagged);

/// [N] blending weights of each Gaussian, rounded to 1/256 per pixel and summed over the pixels, in that unit.
/// @param certain [N] receives 0 where rounding of a weight may go either way
std::vector<std::int64_t> blending_weights(const Scene<double>& scene, const Camera& camera, const Options& options,
                                           std::vector<std::uint8_t>& certain);

/// dL/d image; empty means zero.
struct ImageGradients {
  std::vector<double> color;
  std::vector<double> features;
  std::vector<double> inverse_depth;
  std::vector<double> alpha;
};

struct Gradient {
  std::vector<double> sum;           ///< dL/d input
  std::vector<double> absolute_sum;  ///< Σ over pixels |dL/d input through that pixel|
};

/// Derivative of L = Σ image · image gradient with respect to the given elements of an input (empty: every element).
Gradient gradient(const Scene<double>& scene, const Camera& camera, const Options& options,
                  const ImageGradients& image_gradients, Input input, const std::vector<std::size_t>& elements = {});

/// The value of L.
double objective(const Scene<double>& scene, const Camera& camera, const Options& options,
                 const ImageGradients& image_gradients);

/// Derivative of L along a direction in the space of all inputs. The direction's fields are empty (zero) or have the
/// shapes of the scene's.
double directional_derivative(const Scene<double>& scene, const Scene<double>& direction, const Camera& camera,
                              const Options& options, const ImageGradients& image_gradients);

}  // namespace splatboost::reference
