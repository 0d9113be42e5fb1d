// SPDX-License-Identifier: Apache-2.0
/// @file Forward and backward pass from anchors to the Gaussians of one view, on CPU or GPU: culling of the anchors and
/// decoding.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "families/anchors/anchor_decoder.h"
#include "splatboost/camera.h"
#include "splatboost/device.h"

namespace splatboost {

/// Marks an unused list entry: on a GPU the host does not know the number of anchors and slots in view.
inline constexpr std::uint32_t kNothing = 0xffffffffu;

/// The Gaussians of a view, in device memory.
struct ViewGaussians {
  std::size_t count = 0;                   ///< M
  std::span<const float> means;            ///< [M,3]
  std::span<const float> scales;           ///< [M,3]
  std::span<const float> rotations;        ///< [M,4] not normalised
  std::span<const float> opacities;        ///< [M] in (0, 1); negative, so not drawn, for unused entries
  std::span<const float> colors;           ///< [M,3]
  std::span<const std::uint32_t> slots;    ///< [M] ascending, anchor·k + offset; on a GPU some are kNothing
  std::span<const std::uint32_t> anchors;  ///< [V] in view, ascending; on a GPU padded with kNothing
  std::span<const float> all_opacities;    ///< [V,k] of all slots of `anchors`, in (-1, 1)
};

/// Owns the workspace of one view; a steady loop does not allocate, and on a GPU does not synchronise. Spans of inputs
/// and gradients are in device memory.
class AnchorView {
 public:
  /// Throws NoDeviceError for a GPU if this build has no CUDA or the machine has no cuBLAS.
  AnchorView(const DecoderShape& shape, Device device);
  ~AnchorView();
  AnchorView(AnchorView&&) noexcept;
  AnchorView& operator=(AnchorView&&) noexcept;

  /// The result is valid until the next call.
  /// @param usable [N] zero where the view may not use an anchor; empty: it may use all
  /// @param ahead on a GPU do not wait for the number of anchors in view. Until the numbers of 64 views are known,
  /// there is room for all anchors, then for 1.5 times the largest number; the last anchors of a view with more are
  /// left out
  const ViewGaussians& decode(const Camera& camera, const DecoderInputs<float>& inputs,
                              std::span<const std::uint8_t> usable, bool ahead);

  /// Discards the known numbers of anchors in view; call when the share of usable anchors changes.
  void forget_views();

  /// Adds the gradient of `weight` × the mean volume Π scales of the Gaussians.
  /// @param scale_gradients [M,3]
  /// @param ahead on a GPU do not wait for the loss
  /// @return the loss; with `ahead` on a GPU the latest known one, 0 before the first. Once not finite, it stays so
  double add_volume_loss(double weight, std::span<float> scale_gradients, bool ahead);

  /// Backward pass of the last decode(); its inputs must be unchanged.
  void backward(const DecoderInputs<float>& inputs, const NeuralGaussianGradients<float>& given,
                const DecoderGradients<float>& gradients);

  /// Implementation on one device.
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
