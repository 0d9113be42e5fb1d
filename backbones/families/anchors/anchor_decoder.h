// SPDX-License-Identifier: Apache-2.0
/// @file Decoding of anchors to the Gaussians of one view, and its backward pass (Scaffold-GS, Lu et al. 2024): each
/// anchor in view has k Gaussians, whose opacities, colours and shapes are predicted by three MLPs from the anchor's
/// feature and the viewing direction.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "families/nets/two_layer_net.h"
#include "splatboost/threads.h"

namespace splatboost {

/// Inputs and sizes of the nets.
struct DecoderShape {
  std::size_t features = 32;      ///< F, width of an anchor's feature and of the nets' hidden layers
  std::size_t offsets = 10;       ///< k, Gaussians per anchor
  std::size_t appearance = 0;     ///< size of a view's embedding, an input of the colour net; 0: none
  bool opacity_distance = false;  ///< whether the distance to the camera is an input of the net
  bool covariance_distance = false;
  bool color_distance = false;
  bool level = false;         ///< whether the anchor's level is an input of all nets
  bool feature_bank = false;  ///< view-dependent mix of three resolutions of the feature
  bool bank_distance = true;  ///< whether the distance is an input of the bank's net

  NetShape opacity() const { return {common(opacity_distance), features, offsets}; }
  NetShape covariance() const { return {common(covariance_distance), features, 7 * offsets}; }
  NetShape color() const { return {common(color_distance) + appearance, features, 3 * offsets}; }
  NetShape bank() const { return {3 + std::size_t{bank_distance} + std::size_t{level}, features, 3}; }

 private:
  std::size_t common(bool distance) const { return features + 3 + std::size_t{distance} + std::size_t{level}; }
};

/// Inputs of the decoder; views of the caller's memory.
template <class Real>
struct DecoderInputs {
  std::span<const Real> positions;  ///< [N,3] of the anchors, world space
  std::span<const Real> offsets;    ///< [N,k,3] in units of the anchor's scales 0..2
  std::span<const Real> features;   ///< [N,F]
  std::span<const Real> scales;     ///< [N,6] activated: 0..2 scale the offsets, 3..5 bound the Gaussians' scales
  std::span<const Real> levels;     ///< [N] if DecoderShape::level, else empty
  std::span<const Real> opacity_net, covariance_net, color_net, bank_net;  ///< parameters, see NetShape
  std::span<const Real> embedding;                                         ///< [appearance] of the view
};

/// Gradients with respect to DecoderInputs; they are added to.
template <class Real>
struct DecoderGradients {
  std::span<Real> offsets;
  std::span<Real> features;
  std::span<Real> log_scales;  ///< [N,6] with respect to the logarithms of `scales`
  std::span<Real> opacity_net, covariance_net, color_net, bank_net;
  std::span<Real> embedding;
};

/// M Gaussians of a view, in ascending order of their slots; a slot is anchor·k + offset.
template <class Real>
struct NeuralGaussians {
  std::vector<Real> means, scales, rotations, opacities, colors;  ///< rotations not normalised, opacities in (0, 1)
  std::vector<std::uint32_t> slots;                               ///< [M] ascending
  std::size_t size() const { return slots.size(); }
};

/// Gradients with respect to the Gaussians, of the same shapes.
template <class Real>
struct NeuralGaussianGradients {
  std::span<const Real> means, scales, rotations, opacities, colors;
};

/// Owns the workspace of one view, which is reused, so that a steady loop does not allocate. Results do not depend on
/// the number of threads: anchors are processed in blocks of fixed size, whose net gradients are summed in order.
template <class Real>
class AnchorDecoder {
 public:
  AnchorDecoder(const DecoderShape& shape, const Threads& threads) : shape_(shape), threads_(threads) {}

  /// Decodes the given anchors (ascending) as seen from `centre`; slots with an opacity above 0 become Gaussians. The
  /// result is valid until the next call.
  const NeuralGaussians<Real>& forward(const DecoderInputs<Real>& inputs, std::span<const std::uint32_t> anchors,
                                       const std::array<Real, 3>& centre);

  /// Backward pass of the last forward(); its inputs must be unchanged.
  void backward(const DecoderInputs<Real>& inputs, const NeuralGaussianGradients<Real>& given,
                const DecoderGradients<Real>& gradients);

  /// [V,k] opacities of all slots of the anchors in the last forward(), in (-1, 1).
  std::span<const Real> all_opacities() const { return opacity_; }

 private:
  struct Scratch;
  void pack_features(const DecoderInputs<Real>& inputs, std::size_t begin, std::size_t end, Real* mixed) const;
  void pack_bank_input(const DecoderInputs<Real>& inputs, std::size_t begin, std::size_t end, Real* x) const;
  void pack_input(const DecoderInputs<Real>& inputs, std::size_t begin, std::size_t end, const Real* mixed,
                  bool distance, bool appearance, Real* x) const;
  void backward_block(const DecoderInputs<Real>& inputs, const NeuralGaussianGradients<Real>& given,
                      const DecoderGradients<Real>& gradients, std::size_t begin, std::size_t end,
                      std::span<Real> net_gradients);
  std::size_t all_net_parameters() const;

  DecoderShape shape_;
  Threads threads_;
  std::vector<std::uint32_t> anchors_;              ///< [V]
  std::vector<Real> view_;                          ///< [V,4] direction and distance
  std::vector<Real> opacity_, covariance_, color_;  ///< [V,k], [V,7k] raw, [V,3k] activated
  std::vector<Real> opacity_hidden_, covariance_hidden_, color_hidden_, bank_hidden_;  ///< [V,F]
  std::vector<Real> bank_;             ///< [V,3] weights of the feature bank
  std::vector<std::uint32_t> first_;   ///< [V+1] first Gaussian of each anchor
  std::vector<Real> block_gradients_;  ///< [blocks, all net parameters and the embedding]
  NeuralGaussians<Real> gaussians_;
};

}  // namespace splatboost
