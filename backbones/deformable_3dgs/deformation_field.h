// SPDX-License-Identifier: Apache-2.0
/// @file The deformation field of Deformable-3DGS (Yang et al. 2024, Sec. 3.2): a net that says of each Gaussian's
/// canonical mean and a time how its mean, quaternion and scales differ then.
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

/// What the field is made of. Its parameters are one flat array: those of the net, then those of the time net.
struct DeformationShape {
  std::size_t position_frequencies = 10;
  std::size_t time_frequencies = 10;
  bool time_net = false;  ///< a net of two layers between the encoded time and the net
  bool rigid = false;     ///< means move by rigid motions, SE(3), in place of shifts
  std::size_t layers = 8;
  std::size_t width = 256;

  std::size_t motion() const { return rigid ? 6 : 3; }  ///< outputs that move the mean
  DeepNetShape net() const;
  NetShape time_shape() const;
  std::size_t parameters() const { return net().parameters() + (time_net ? time_shape().parameters() : 0); }
};

/// Published initial values: uniform in ±1/√(inputs) everywhere, so that the field is small but not zero.
std::vector<float> initial_deformation(const DeformationShape& shape, const RandomStream& random);

/// Means [N,3], activated scales [N,3], quaternions [N,4] of any length but 0.
template <class Real>
struct GaussianPlaces {
  std::span<Real> means, scales, rotations;
};

/// The field with its workspace. Spans are of memory of the device; a steady loop allocates nothing, and on a GPU it
/// does not wait.
class DeformationField {
 public:
  /// Throws NoDeviceError where a GPU cannot do it: this build has no CUDA, or the machine no cuBLAS.
  DeformationField(const DeformationShape& shape, Device device);
  ~DeformationField();

  /// What is kept of a Gaussian between the two, in bytes: about.
  static std::size_t bytes_per_gaussian(const DeformationShape& shape);

  /// Gaussians as they are at a time. Scales may come out negative: a Gaussian is the same with either sign.
  /// @param keep whether backward() follows
  void forward(std::span<const float> parameters, const GaussianPlaces<const float>& at, float time,
               const GaussianPlaces<float>& moved, bool keep);
  /// Of the last forward(), whose parameters and Gaussians must be unchanged; once. What the net says depends on means
  /// too, but by it no gradient goes to them: as published.
  /// @param given of the moved ones @param of_gaussians are added to @param of_parameters are added to
  void backward(std::span<const float> parameters, const GaussianPlaces<const float>& at,
                const GaussianPlaces<const float>& given, const GaussianPlaces<float>& of_gaussians,
                std::span<float> of_parameters);

  /// What each device does of this.
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
