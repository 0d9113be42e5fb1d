// SPDX-License-Identifier: Apache-2.0
/// @file The operations of this folder on a CUDA device, as the public functions call them, which have checked the
/// arguments. Each is defined in the .cu file of its name; a build without CUDA has cuda_absent.cpp in their place.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "geometry/surface_workspace.h"
#include "splatboost/cuda_stream.h"
#include "splatboost/gaussians.h"
#include "splatboost/photometric.h"

namespace splatboost::cuda {

/// As in gaussian_planes.h.
void gaussian_planes(const Gaussians& gaussians, const Camera& camera, std::span<float> planes, CudaStream& stream);
void gaussian_planes_backward(const Gaussians& gaussians, const Camera& camera, std::span<const float> plane_gradients,
                              std::span<float> means, std::span<float> rotations, CudaStream& stream);
void flatness_loss(std::span<const float> scales, std::span<const std::uint8_t> visible, float weight,
                   std::span<double> sums, CudaStream& stream);
void flatness_loss_backward(std::span<const float> scales, std::span<const std::uint8_t> visible, float weight,
                            std::span<const double> sums, std::span<float> gradients, CudaStream& stream);

/// As in surface_depth.h.
void plane_depth(const Camera& camera, std::span<const float> planes, std::span<float> depth, CudaStream& stream);
void plane_depth_backward(const Camera& camera, std::span<const float> planes, std::span<const float> depth_gradients,
                          std::span<float> plane_gradients, CudaStream& stream);
void depth_normals(const Camera& camera, std::span<const float> depth, std::span<float> normals, CudaStream& stream);

/// As in surface_loss.h: what its parts add, to the sums of the workspace too.
void add_normal_term(const SurfaceView& first, const SurfaceTerms& terms, SurfaceWorkspace& workspace,
                     CudaStream& stream);
void add_two_view_terms(const SurfaceView& first, const SurfaceView& second, const SurfaceTerms& terms,
                        const RandomStream& random, SurfaceWorkspace& workspace, CudaStream& stream);
/// The loss on its way to the host.
class PendingSurfaceLoss {
 public:
  explicit PendingSurfaceLoss(CudaStream& stream);
  ~PendingSurfaceLoss();
  /// Sends the sums of the workspace, of a call with these terms and so many pixels.
  void send(const SurfaceWorkspace& workspace, const SurfaceTerms& terms, std::size_t pixels);
  /// The newest that has arrived; one that is not finite stays.
  SurfaceLossParts newest();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// As in exposure.h.
void expose(std::span<const float> render, std::span<const float> exposure, std::span<float> exposed,
            CudaStream& stream);
void add_exposed_l1(std::span<const float> render, const TruthImage& truth, std::span<const float> exposure,
                    float weight, std::span<float> gradient, std::span<float> exposure_gradient,
                    std::span<double> workspace, CudaStream& stream);

}  // namespace splatboost::cuda
