// SPDX-License-Identifier: Apache-2.0
/// @file Implementation of Rasterizer on one device. Rasterizer checks the arguments and forwards them; contracts are
/// those of its functions of the same names.
#pragma once

#include <memory>

#include "splatboost/rasterizer.h"

namespace splatboost {

class RasterizerBackend {
 public:
  virtual ~RasterizerBackend() = default;
  virtual void forward(const Camera& camera, const Gaussians& gaussians, const RasterOptions& options,
                       const RasterImages& images) = 0;
  virtual void backward(const Gaussians& gaussians, const RasterImageGradients& image_gradients,
                        const GaussianGradients& gradients) = 0;
  virtual void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) = 0;
  virtual void count_observed(float min_transmittance, std::span<std::int32_t> counts) = 0;
  virtual void add_weights(std::span<std::int32_t> weights) = 0;
  virtual bool settle() = 0;
  virtual std::span<const std::uint8_t> visible() const = 0;
  virtual std::span<const std::int32_t> screen_radii() const = 0;
  virtual RasterCounts counts() = 0;
  virtual const RasterSeconds& seconds() = 0;
};

std::unique_ptr<RasterizerBackend> make_cpu_rasterizer(const Threads& threads);

}  // namespace splatboost
