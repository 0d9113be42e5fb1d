// SPDX-License-Identifier: Apache-2.0
/// @file The deformation field of Deformable-3DGS (Yang et al. 2024, Sec. 3.2): an MLP that maps a Gaussian's canonical
/// mean and a time to changes of its mean, quaternion and scales.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "families/nets/deep_net.h"
#include "families/nets/two_layer_net.h"
#include "splatboost/device.h"
#include "splatboost/random.h"

namespace splatboost {

/// Sizes of the field. Its parameters are one flat array: those of the net, then those of the time net.
struct DeformationShape {
  std::size_t position_frequencies = 10;
  std::size_t time_frequencies = 10;
  bool time_net = false;  ///< a two-layer net between the encoded time and the net
  bool rigid = false;     ///< means move by rigid motions, SE(3), instead of offsets
  std::size_t layers = 8;
  std::size_t width = 256;

  std::size_t motion() const { return rigid ? 6 : 3; }  ///< number of outputs that move the mean
  DeepNetShape net() const;
  NetShape time_shape() const;
  std::size_t parameters() const { return net().parameters() + (time_net ? time_shape().parameters() : 0); }
};

/// Initial values as published: all uniform in ±1/√(inputs), so that the field is small but not zero.
std::vector<float> initial_deformation(const DeformationShape& shape, const RandomStream& random);

/// Means [N,3], activated scales [N,3], quaternions [N,4] of any nonzero length.
template <class Real>
struct GaussianPlaces {
  std::span<Real> means, scales, rotations;
};

/// The field with its workspace. Spans are in device memory; a steady loop does not allocate, and on a GPU does not
/// synchronise.
class DeformationField {
 public:
  /// Throws NoDeviceError for a GPU if this build has no CUDA or the machine has no cuBLAS.
  DeformationField(const DeformationShape& shape, Device device);
  ~DeformationField();

  /// Approximate memory per Gaussian that is kept between forward() and backward(), in bytes.
  static std::size_t bytes_per_gaussian(const DeformationShape& shape);

  /// Computes the Gaussians at a time. Scales may become negative; their sign has no effect.
  /// @param keep whether backward() follows
  void forward(std::span<const float> parameters, const GaussianPlaces<const float>& at, float time,
               const GaussianPlaces<float>& moved, bool keep);
  /// Backward pass of the last forward(); its parameters and Gaussians must be unchanged. Call it at most once per
  /// forward(). As published, no gradient flows to the means through the inputs of the net.
  /// @param given with respect to the moved Gaussians
  /// @param of_gaussians are added to @param of_parameters are added to
  void backward(std::span<const float> parameters, const GaussianPlaces<const float>& at,
                const GaussianPlaces<const float>& given, const GaussianPlaces<float>& of_gaussians,
                std::span<float> of_parameters);

  /// Implementation on one device.
  class Work {
   public:
    virtual ~Work() = default;
    virtual void forward(std::span<const float> parameters, const GaussianPlaces<const float>& at, float time,
                         const GaussianPlaces<float>& moved, bool keep) = 0;
    virtual void backward(std::span<const float> parameters, const GaussianPlaces<const float>& at,
                          const GaussianPlaces<const float>& given, const GaussianPlaces<float>& of_gaussians,
                          std::span<float> of_parameters) = 0;
  };

 private:
  std::unique_ptr<Work> work_;
};

namespace cuda {
std::unique_ptr<DeformationField::Work> make_deformation_field(const DeformationShape& shape, CudaStream& stream);
}  // namespace cuda

}  // namespace splatboost
