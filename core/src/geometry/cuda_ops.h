// SPDX-License-Identifier: Apache-2.0
/// @file CUDA implementations of this folder's operations, called by the public functions, which check the arguments.
/// Each is defined in the .cu file of its name; a build without CUDA compiles cuda_absent.cpp instead.
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

/// The terms of surface_loss.h: add their gradients, and their sums to those of the workspace.
void add_normal_term(const SurfaceView& first, const SurfaceTerms& terms, SurfaceWorkspace& workspace,
                     CudaStream& stream);
void add_two_view_terms(const SurfaceView& first, const SurfaceView& second, const SurfaceTerms& terms,
                        const RandomStream& random, SurfaceWorkspace& workspace, CudaStream& stream);
/// Losses being copied to the host.
class PendingSurfaceLoss {
 public:
  explicit PendingSurfaceLoss(CudaStream& stream);
  ~PendingSurfaceLoss();
  /// Starts copying the workspace's sums, which are of a call with these terms and this number of pixels.
  void send(const SurfaceWorkspace& workspace, const SurfaceTerms& terms, std::size_t pixels);
  /// The newest loss that has arrived, or the first that was not finite.
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
