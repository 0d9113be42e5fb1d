// SPDX-License-Identifier: Apache-2.0
// Replaces the .cu files of this folder in a build without CUDA. There is no stream then, so nothing here is called.
#include "device/cuda_absent.h"
#include "geometry/cuda_ops.h"

namespace splatboost::cuda {

void gaussian_planes(const Gaussians&, const Camera&, std::span<float>, CudaStream&) { absent(); }
void gaussian_planes_backward(const Gaussians&, const Camera&, std::span<const float>, std::span<float>,
                              std::span<float>, CudaStream&) {
  absent();
}
void flatness_loss(std::span<const float>, std::span<const std::uint8_t>, float, std::span<double>, CudaStream&) {
  absent();
}
void flatness_loss_backward(std::span<const float>, std::span<const std::uint8_t>, float, std::span<const double>,
                            std::span<float>, CudaStream&) {
  absent();
}
void plane_depth(const Camera&, std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void plane_depth_backward(const Camera&, std::span<const float>, std::span<const float>, std::span<float>,
                          CudaStream&) {
  absent();
}
void depth_normals(const Camera&, std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void add_normal_term(const SurfaceView&, const SurfaceTerms&, SurfaceWorkspace&, CudaStream&) { absent(); }
void add_two_view_terms(const SurfaceView&, const SurfaceView&, const SurfaceTerms&, const RandomStream&,
                        SurfaceWorkspace&, CudaStream&) {
  absent();
}
struct PendingSurfaceLoss::State {};
PendingSurfaceLoss::PendingSurfaceLoss(CudaStream&) { absent(); }
PendingSurfaceLoss::~PendingSurfaceLoss() = default;
void PendingSurfaceLoss::send(const SurfaceWorkspace&, const SurfaceTerms&, std::size_t) { absent(); }
SurfaceLossParts PendingSurfaceLoss::newest() { absent(); }
void expose(std::span<const float>, std::span<const float>, std::span<float>, CudaStream&) { absent(); }
void add_exposed_l1(std::span<const float>, const TruthImage&, std::span<const float>, float, std::span<float>,
                    std::span<float>, std::span<double>, CudaStream&) {
  absent();
}

}  // namespace splatboost::cuda
