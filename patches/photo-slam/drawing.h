// SPDX-License-Identifier: Apache-2.0
/// @file How a model is drawn by SplatBoost's rasterizer. Of the files beside it, not of the host.
#pragma once

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <unordered_map>
#include <vector>

#include <torch/torch.h>

#include "include/gaussian_rasterizer.h"
#include "splatboost/c_api.h"
#include "splatboost/tensors.h"

namespace splatboost {

/// What the library is given of N Gaussians.
struct Gaussians {
  Given means, scales, rotations, covariances, opacities, sh_dc, sh_rest, colors;
  sb_gaussians view{};

  /// @param inputs means, opacities, sh, colors, scales, rotations, covariances; of the last five those of one
  /// dimension are not given
  Gaussians(const std::vector<Tensor>& inputs, int sh_degree);
};

class Drawing {
 public:
  /// @param beta of the compact box; 0: 3DGS's square
  explicit Drawing(float beta) : beta_(beta) {}
  Drawing(const Drawing&) = delete;
  Drawing& operator=(const Drawing&) = delete;
  ~Drawing() { sb_rasterizer_destroy(rasterizer_); }

  struct Image {
    Tensor color, radii;
    std::uint64_t number = 0;  ///< of the draw
  };

  Image draw(const sb_camera& camera, const sb_raster_options& options, const Gaussians& gaussians);
  /// Whether this draw is still the last one.
  bool is_last(std::uint64_t number) const { return number == number_; }
  sb_rasterizer* rasterizer() const { return rasterizer_; }

  sb_raster_options options(const Tensor& background);
  sb_camera camera(const GaussianRasterizationSettings& settings);

  /// [N,2] sums over pixels of the last backward pass's absolute gradients on screen, in NDC units.
  Tensor absolute_gradients;
  /// Held while anything above is called: when the run ends the mapper draws without the host's own lock, and the
  /// viewer may draw at the same time.
  std::mutex mutex;

 private:
  /// A small tensor's numbers. Those of the same tensor are fetched from a GPU once.
  const std::vector<float>& on_host(const Tensor& tensor);

  struct Fetched {
    Tensor tensor;  // held, so that no other has its address
    std::uint64_t version = 0;
    std::vector<float> numbers;
  };

  float beta_;
  sb_rasterizer* rasterizer_ = nullptr;
  std::uint64_t number_ = 0;
  std::unordered_map<const void*, Fetched> on_host_;
};

}  // namespace splatboost
