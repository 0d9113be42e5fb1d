// SPDX-License-Identifier: Apache-2.0
/// @file What training does with the anchors of one view, on either device: which of them are in view, the Gaussians
/// that they offer, and the way back.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "families/anchors/anchor_decoder.h"
#include "splatboost/camera.h"
#include "splatboost/device.h"

namespace splatboost {

/// A place of a list that holds nothing: how many of a view's anchors and slots there are is known to a GPU only.
inline constexpr std::uint32_t kNothing = 0xffffffffu;

/// The Gaussians of a view, in memory of the device.
struct ViewGaussians {
  std::size_t count = 0;                   ///< M
  std::span<const float> means;            ///< [M,3]
  std::span<const float> scales;           ///< [M,3]
  std::span<const float> rotations;        ///< [M,4] of any length
  std::span<const float> opacities;        ///< [M] in (0, 1); below 0, which is not drawn, where there is no slot
  std::span<const float> colors;           ///< [M,3]
  std::span<const std::uint32_t> slots;    ///< [M] ascending, anchor·k + offset; on a GPU some are kNothing
  std::span<const std::uint32_t> anchors;  ///< [V] in view, ascending; on a GPU kNothing comes behind them
  std::span<const float> all_opacities;    ///< [V,k] of all slots of these, in (-1, 1)
};

/// Owns the workspace of one view; a steady loop allocates nothing, and on a GPU it does not wait. Spans of inputs and
/// gradients are of memory of the device.
class AnchorView {
 public:
  /// Throws NoDeviceError where a GPU cannot do it: this build has no CUDA, or the machine no cuBLAS.
  AnchorView(const DecoderShape& shape, Device device);
  ~AnchorView();
  AnchorView(AnchorView&&) noexcept;
  AnchorView& operator=(AnchorView&&) noexcept;

  /// Valid until the next call.
  /// @param usable [N] zero where the view may not use an anchor; empty: it may use all
  /// @param ahead on a GPU do not wait for the number of anchors in view. There is room for all until 64 views are
  /// known, then for half as many again as any of them had; a view that has more goes without the last of them
  const ViewGaussians& decode(const Camera& camera, const DecoderInputs<float>& inputs,
                              std::span<const std::uint8_t> usable, bool ahead);

  /// From now on views have other shares of the anchors than before: nothing is known of them.
  void forget_views();

  /// Adds the gradient of `weight` × the mean volume Π scales of the Gaussians.
  /// @param scale_gradients [M,3]
  /// @param ahead on a GPU do not wait: the loss that is returned is the newest that has come back, 0 until one has, or
  /// the first that was not finite
  /// @return that loss
  double add_volume_loss(double weight, std::span<float> scale_gradients, bool ahead);

  /// Of the last decode(), whose inputs must be unchanged.
  void backward(const DecoderInputs<float>& inputs, const NeuralGaussianGradients<float>& given,
                const DecoderGradients<float>& gradients);

  /// What each device does of this.
  class Work {
   public:
    virtual ~Work() = default;
    virtual const ViewGaussians& decode(const Camera& camera, const DecoderInputs<float>& inputs,
                                        std::span<const std::uint8_t> usable, bool ahead) = 0;
    virtual void forget_views() = 0;
    virtual double add_volume_loss(double weight, std::span<float> scale_gradients, bool ahead) = 0;
    virtual void backward(const DecoderInputs<float>& inputs, const NeuralGaussianGradients<float>& given,
                          const DecoderGradients<float>& gradients) = 0;
  };

 private:
  std::unique_ptr<Work> work_;
};

}  // namespace splatboost
