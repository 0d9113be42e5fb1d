// SPDX-License-Identifier: Apache-2.0
/// @file Draws a model with SplatBoost's rasterizer. Used by the files beside it, not by the host.
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

/// The parameters of N Gaussians as the library takes them.
struct Gaussians {
  Given means, scales, rotations, covariances, opacities, sh_dc, sh_rest, colors;
  sb_gaussians view{};

  /// @param inputs means, opacities, sh, colors, scales, rotations, covariances; one-dimensional tensors among the
  /// last five count as absent
  Gaussians(const std::vector<Tensor>& inputs, int sh_degree);
};

class Drawing {
 public:
  /// @param beta of the compact box; 0: the square box of 3DGS
  explicit Drawing(float beta) : beta_(beta) {}
  Drawing(const Drawing&) = delete;
  Drawing& operator=(const Drawing&) = delete;
  ~Drawing() { sb_rasterizer_destroy(rasterizer_); }

  struct Image {
    Tensor color, radii;
    std::uint64_t number = 0;  ///< sequence number of the draw
  };

  Image draw(const sb_camera& camera, const sb_raster_options& options, const Gaussians& gaussians);
  /// Whether this draw is the most recent one.
  bool is_last(std::uint64_t number) const { return number == number_; }
  sb_rasterizer* rasterizer() const { return rasterizer_; }

  sb_raster_options options(const Tensor& background);
  sb_camera camera(const GaussianRasterizationSettings& settings);

  /// [N,2] absolute per-pixel gradients of the screen means, summed over pixels, in NDC units; of the last backward.
  Tensor absolute_gradients;
  /// Hold it while calling anything above: when the run ends, the mapper draws without the host's own lock while the
  /// viewer may still draw.
  std::mutex mutex;

 private:
  /// The values of a small tensor. They are copied from the GPU only once per tensor and version.
  const std::vector<float>& on_host(const Tensor& tensor);

  struct Fetched {
    Tensor tensor;  // kept alive, so that no other tensor gets its address
    std::uint64_t version = 0;
    std::vector<float> numbers;
  };

  float beta_;
  sb_rasterizer* rasterizer_ = nullptr;
  std::uint64_t number_ = 0;
  std::unordered_map<const void*, Fetched> on_host_;
};

}  // namespace splatboost
