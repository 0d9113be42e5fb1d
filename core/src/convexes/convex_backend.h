// SPDX-License-Identifier: Apache-2.0
/// @file Implementation of ConvexRasterizer on one device. ConvexRasterizer checks the arguments and forwards them;
/// contracts are those of its functions of the same names.
#pragma once

#include <memory>

#include "splatboost/convex_rasterizer.h"

namespace splatboost {

class ConvexBackend {
 public:
  virtual ~ConvexBackend() = default;
  virtual void forward(const Camera& camera, const Convexes& convexes, const ConvexOptions& options,
                       std::span<float> color, std::span<float> alpha) = 0;
  virtual void backward(const Convexes& convexes, std::span<const float> color, std::span<const float> alpha,
                        const ConvexGradients& gradients) = 0;
  virtual void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) = 0;
  virtual void add_weights(std::span<std::int32_t> weights) = 0;
  virtual bool settle() = 0;
  virtual std::span<const std::uint8_t> visible() const = 0;
  virtual ConvexCounts counts() = 0;
  virtual const RasterSeconds& seconds() = 0;
};

std::unique_ptr<ConvexBackend> make_cpu_convex_rasterizer(const Threads& threads);

}  // namespace splatboost
