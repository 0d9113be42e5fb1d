// SPDX-License-Identifier: Apache-2.0
#include "families/anchors/anchor_view.h"

#include <vector>

#include "families/anchors/anchor_prefilter.h"
#include "families/anchors/cuda_anchors.h"

namespace splatboost {
namespace {

class WorkOnCpu final : public AnchorView::Work {
 public:
  WorkOnCpu(const DecoderShape& shape, const Threads& threads) : threads_(threads), decoder_(shape, threads) {}

  const ViewGaussians& decode(const Camera& camera, const DecoderInputs<float>& inputs,
                              std::span<const std::uint8_t> usable, bool /*ahead*/) override {
    anchors_in_view(camera, inputs.positions, inputs.scales, usable, threads_, in_view_, anchors_);
    const glm::vec3 centre = camera.centre();
    const NeuralGaussians<float>& g = decoder_.forward(inputs, anchors_, {centre.x, centre.y, centre.z});
    gaussians_ = {
        g.size(), g.means, g.scales, g.rotations, g.opacities, g.colors, g.slots, anchors_, decoder_.all_opacities()};
    return gaussians_;
  }

  void forget_views() override {}

  double add_volume_loss(double weight, std::span<float> scale_gradients, bool /*ahead*/) override {
    const std::size_t m = gaussians_.count;
    if (m == 0) return 0;
    const float share = static_cast<float>(weight / static_cast<double>(m));
    double sum = 0;
    for (std::size_t i = 0; i < m; ++i) {
      const float* s = &gaussians_.scales[3 * i];
      float* g = &scale_gradients[3 * i];
      g[0] += share * s[1] * s[2];
      g[1] += share * s[0] * s[2];
      g[2] += share * s[0] * s[1];
      sum += static_cast<double>(s[0]) * s[1] * s[2];
    }
    return weight * sum / static_cast<double>(m);
  }

  void backward(const DecoderInputs<float>& inputs, const NeuralGaussianGradients<float>& given,
                const DecoderGradients<float>& gradients) override {
    decoder_.backward(inputs, given, gradients);
  }

 private:
  Threads threads_;
  AnchorDecoder<float> decoder_;
  std::vector<std::uint8_t> in_view_;  ///< [N]
  std::vector<std::uint32_t> anchors_;
  ViewGaussians gaussians_;
};

}  // namespace

AnchorView::AnchorView(const DecoderShape& shape, Device device) {
  if (device.is_cuda()) {
    work_ = cuda::make_anchor_view(shape, device.stream());
  } else {
    work_ = std::make_unique<WorkOnCpu>(shape, device.threads());
  }
}
AnchorView::~AnchorView() = default;
AnchorView::AnchorView(AnchorView&&) noexcept = default;
AnchorView& AnchorView::operator=(AnchorView&&) noexcept = default;

const ViewGaussians& AnchorView::decode(const Camera& camera, const DecoderInputs<float>& inputs,
                                        std::span<const std::uint8_t> usable, bool ahead) {
  return work_->decode(camera, inputs, usable, ahead);
}

void AnchorView::forget_views() { work_->forget_views(); }

double AnchorView::add_volume_loss(double weight, std::span<float> scale_gradients, bool ahead) {
  return weight == 0 ? 0 : work_->add_volume_loss(weight, scale_gradients, ahead);
}

void AnchorView::backward(const DecoderInputs<float>& inputs, const NeuralGaussianGradients<float>& given,
                          const DecoderGradients<float>& gradients) {
  work_->backward(inputs, given, gradients);
}

}  // namespace splatboost
