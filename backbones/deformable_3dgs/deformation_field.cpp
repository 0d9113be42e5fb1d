// SPDX-License-Identifier: Apache-2.0
#include "deformable_3dgs/deformation_field.h"

#include "deformable_3dgs/deformation_math.h"
#include "deformable_3dgs/deformation_on_cpu.h"
#include "families/nets/frequency_encoding.h"

namespace splatboost {
namespace {

constexpr std::size_t kTimeWidth = 256, kTimeOutputs = 30;  // of the time net, as released

class WorkOnCpu final : public DeformationField::Work {
 public:
  WorkOnCpu(const DeformationShape& shape, const Threads& threads) : field_(shape, threads) {}
  void forward(std::span<const float> parameters, const GaussianPlaces<const float>& at, float time,
               const GaussianPlaces<float>& moved, bool keep) override {
    field_.forward(parameters, at, time, moved, keep);
  }
  void backward(std::span<const float> parameters, const GaussianPlaces<const float>& at,
                const GaussianPlaces<const float>& given, const GaussianPlaces<float>& of_gaussians,
                std::span<float> of_parameters) override {
    field_.backward(parameters, at, given, of_gaussians, of_parameters);
  }

 private:
  DeformationOnCpu<float> field_;
};

}  // namespace

DeepNetShape DeformationShape::net() const {
  DeepNetShape net;
  net.inputs = encoded_width(3, position_frequencies);
  net.shared = time_net ? kTimeOutputs : encoded_width(1, time_frequencies);
  net.hidden = width;
  net.layers = layers;
  net.joined = layers / 2 + 1 < layers ? layers / 2 + 1 : 0;  // with 8 layers: after the fifth
  net.outputs = delta_width(motion());
  return net;
}

NetShape DeformationShape::time_shape() const { return {encoded_width(1, time_frequencies), kTimeWidth, kTimeOutputs}; }

std::vector<float> initial_deformation(const DeformationShape& shape, const RandomStream& random) {
  std::vector<float> parameters = initial_deep_net_parameters(shape.net(), random, 0);
  if (shape.time_net) {
    const std::vector<float> of_time = initial_net_parameters(shape.time_shape(), random, parameters.size());
    parameters.insert(parameters.end(), of_time.begin(), of_time.end());
  }
  return parameters;
}

std::size_t DeformationField::bytes_per_gaussian(const DeformationShape& shape) {
  const std::size_t moved = 10, deltas = delta_width(shape.motion());
  return DeepNet<float>::bytes_per_row(shape.net()) + 2 * sizeof(float) * (moved + deltas);
}

DeformationField::DeformationField(const DeformationShape& shape, Device device) {
  if (device.is_cuda()) {
    work_ = cuda::make_deformation_field(shape, device.stream());
  } else {
    work_ = std::make_unique<WorkOnCpu>(shape, device.threads());
  }
}
DeformationField::~DeformationField() = default;

void DeformationField::forward(std::span<const float> parameters, const GaussianPlaces<const float>& at, float time,
                               const GaussianPlaces<float>& moved, bool keep) {
  work_->forward(parameters, at, time, moved, keep);
}

void DeformationField::backward(std::span<const float> parameters, const GaussianPlaces<const float>& at,
                                const GaussianPlaces<const float>& given, const GaussianPlaces<float>& of_gaussians,
                                std::span<float> of_parameters) {
  work_->backward(parameters, at, given, of_gaussians, of_parameters);
}

}  // namespace splatboost
