// SPDX-License-Identifier: Apache-2.0
/// @file Consistency losses for the surfaces of one or two views (PGSR, Chen et al. 2024, Sec. 3.2): blended normals
/// against normals of the depth, depth of one view against that of another, and patches of the two photos.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "splatboost/camera.h"
#include "splatboost/device.h"
#include "splatboost/photometric.h"
#include "splatboost/random.h"

namespace splatboost {

/// A photo of a view at another size, from the same pose, in device memory.
struct PatchPhoto {
  const Camera& camera;
  TruthImage truth;
};

/// A rendered view, in device memory.
struct SurfaceView {
  const Camera& camera;
  TruthImage truth;                     ///< empty if the camera has no photo; the view is then compared by depth only
  std::span<const float> planes;        ///< [4,H,W] blended planes of Gaussians
  std::span<const float> alpha;         ///< [H,W]; read for the first view only
  std::span<float> plane_gradients;     ///< [4,H,W] added to
  const PatchPhoto* patches = nullptr;  ///< the photo in which patches are compared; null: truth
};

/// A weight of 0 disables its term. Defaults are those of the release.
struct SurfaceTerms {
  float normal_weight = 0.015f;      ///< for normals in the first view
  bool edge_aware = true;            ///< lower the normal weight where the photo has edges
  float geometric_weight = 0.03f;    ///< for depth in two views
  float photometric_weight = 0.15f;  ///< for patches in two photos
  float max_pixel_noise = 1;         ///< px; pixels with a larger reprojection error count as occluded
  int max_patches = 102400;          ///< approximate limit; patches are drawn at random from matching pixels
  float near_depth = 0.1f;           ///< world units; nearer points are not compared
};

/// Weighted losses of a call.
struct SurfaceLossParts {
  double normal = 0, geometric = 0, photometric = 0;
  double total() const { return normal + geometric + photometric; }
};

/// Owns the workspace of the loss; on a GPU a steady loop allocates nothing. On the CPU the order of summation is
/// fixed.
///
/// With plane depth d, depth normals n_d of the first view (scaled by alpha, which gets no gradient) and its blended
/// normals n:
///   normal = weight · mean over pixels of w·‖n_d − n‖₁, w = (1 − g)², g the photo's largest central difference along x
///   or y, from 0 to 1 within the photo (over pixels without a masked neighbour), 1 on the border; w is 0 where masked.
///   Without edge_aware or a photo w is 1, also on the border, whose depth normals are 0, as in the release.
/// A pixel p of the first view is projected by its depth into the second view and, by the depth there (bilinear), back
/// to p', with noise ε = ‖p' − p‖. Where it stays in the image and in front of both cameras, is masked in neither
/// photo, and ε < max_pixel_noise:
///   geometric = weight · mean of v·ε, v = exp(−ε), through which no gradient passes.
/// For 7×7 patches of the first photo (PatchPhoto, if there are any) around the centres of those pixels, mapped to the
/// second photo by the homography of the first view's blended plane at p (grey = 0.299 r + 0.587 g + 0.114 b):
///   photometric = weight · mean of v·c over those without masked pixels and with c = 1 − cov² / (var·var' + 1e-8)
///   below 0.9.
class SurfaceLoss {
 public:
  explicit SurfaceLoss(Device device);
  ~SurfaceLoss();
  SurfaceLoss(SurfaceLoss&&) noexcept;
  SurfaceLoss& operator=(SurfaceLoss&&) noexcept;

  /// Adds the gradients of all terms to the plane_gradients of the views.
  /// @param second null: only the normal term of the first view
  /// @param random draws the patches
  /// @return the losses; on a GPU the newest that have arrived from an earlier call, without waiting, or 0 if none have
  SurfaceLossParts add(const SurfaceView& first, const SurfaceView* second, const SurfaceTerms& terms,
                       const RandomStream& random);

  /// Memory of its workspace per pixel of a view, in bytes, on its device.
  static std::size_t bytes_per_pixel();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost
