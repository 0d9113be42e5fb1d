// SPDX-License-Identifier: Apache-2.0
/// @file What surfaces of one or two views should agree on (PGSR, Chen et al. 2024, Sec. 3.2): normals with depth,
/// depth of one view with that of another, and what both photos show there.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "splatboost/camera.h"
#include "splatboost/device.h"
#include "splatboost/photometric.h"
#include "splatboost/random.h"

namespace splatboost {

/// A view as it was drawn, in memory of the device.
struct SurfaceView {
  const Camera& camera;
  TruthImage truth;                  ///< empty: of a camera without a photo, which takes part in depth alone
  std::span<const float> planes;     ///< [4,H,W] blended planes of Gaussians
  std::span<const float> alpha;      ///< [H,W]; only that of the first view is read
  std::span<float> plane_gradients;  ///< [4,H,W] are added to
};

/// Weights of 0 leave a term out. Defaults are the release's.
struct SurfaceTerms {
  float normal_weight = 0.015f;      ///< of normals in the first view
  bool edge_aware = true;            ///< less where the photo has edges
  float geometric_weight = 0.03f;    ///< of depth in two views
  float photometric_weight = 0.15f;  ///< of patches in two photos
  float max_pixel_noise = 1;         ///< px; pixels that come back farther away are occluded
  int max_patches = 102400;          ///< about so many are compared, drawn at random from the pixels that agree
  float near_depth = 0.1f;           ///< nearer points are not compared, world units
};

/// The sums of a call.
struct SurfaceLossParts {
  double normal = 0, geometric = 0, photometric = 0;
  double total() const { return normal + geometric + photometric; }
};

/// Owns the workspace of the loss; a steady loop allocates nothing. Sums are of fixed order on the CPU.
///
/// With plane depth d, depth normals n_d of the first view (scaled by alpha, which gets no gradient) and its blended
/// normals n:
///   normal = weight · mean over pixels of w·‖n_d − n‖₁, w = (1 − g)², g the photo's largest central difference along x
///   or y, from 0 to 1 within the photo; w is 0 on the border.
/// A pixel p of the first view goes by its depth to the second, by that one's depth there (bilinear) back to p', with
/// noise ε = ‖p' − p‖. Where that stays in the image, in front of both cameras and below max_pixel_noise:
///   geometric = weight · mean of v·ε, v = exp(−ε), which gets no gradient.
/// For patches of 7×7 pixels around those pixels, carried to the second photo by the homography of the plane that the
/// first view shows in p (grey = 0.299 r + 0.587 g + 0.114 b):
///   photometric = weight · mean of v·c over those with c = 1 − cov² / (var·var' + 1e-8) below 0.9.
class SurfaceLoss {
 public:
  explicit SurfaceLoss(Device device);
  ~SurfaceLoss();
  SurfaceLoss(SurfaceLoss&&) noexcept;
  SurfaceLoss& operator=(SurfaceLoss&&) noexcept;

  /// Adds the gradients of all terms.
  /// @param second null: normals of the first view alone
  /// @param random draws the patches
  /// @return on a GPU the newest that is known, of an earlier call, without waiting; 0 before that
  SurfaceLossParts add(const SurfaceView& first, const SurfaceView* second, const SurfaceTerms& terms,
                       const RandomStream& random);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost
