// SPDX-License-Identifier: Apache-2.0
/// @file SplatBoost in Photo-SLAM: its rasterizer and its decisions in the place of the host's, through the C ABI of
/// libsplatboost. Written by `splatboost patch apply photo-slam`; `splatboost patch revert` removes it.
///
/// A Boost is of the mapper's thread; both threads may draw, one after the other. On a GPU it runs on the default
/// stream, as the host does.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <tuple>

#include <torch/torch.h>

class GaussianModel;
class GaussianRasterizer;
class GaussianScene;
class GaussianOptimizationParams;
class GaussianPipelineParams;

namespace splatboost {

/// How a model is drawn. A model without one is drawn by the host's own rasterizer.
class Drawing;

/// GaussianRasterizer::forward, its arguments and results.
std::tuple<torch::Tensor, torch::Tensor> draw(const std::shared_ptr<Drawing>& drawing, GaussianRasterizer& host,
                                              torch::Tensor means3D, torch::Tensor means2D, torch::Tensor opacities,
                                              bool has_shs, bool has_colors, bool has_scales, bool has_rotations,
                                              bool has_covariances, torch::Tensor shs, torch::Tensor colors,
                                              torch::Tensor scales, torch::Tensor rotations, torch::Tensor covariances);

/// What the mapper asks of the method in an iteration. Errors of the library are thrown as std::runtime_error.
class Boost {
 public:
  /// What of the mapper is read; all of it must outlive the Boost.
  struct Host {
    std::shared_ptr<GaussianModel> gaussians;
    std::shared_ptr<GaussianScene> scene;
    const GaussianOptimizationParams& optimization;
    GaussianPipelineParams& pipeline;
    torch::Tensor& background;
    const std::map<std::uint32_t, torch::Tensor>& masks;  ///< float [3,H,W] of each camera: 1 where a pixel counts
    bool online;                                          ///< keyframes come in while it trains
  };

  /// By these keys of the mapper's settings, each of which may be missing: SplatBoost.on (1; with 0 this gives null),
  /// SplatBoost.max_gaussians (0: no cap), SplatBoost.literal, and any setting of the adapter photo-slam, such as
  /// SplatBoost.beta and SplatBoost.tau_d. A wrong one ends the process with 2 and one line that names it.
  static std::shared_ptr<Boost> make(const std::filesystem::path& settings, const Host& host);
  ~Boost();

  /// Adds a view's gradients to the statistics. @param screen [N,3] with its gradient @param seen bool [N]
  void gather(const torch::Tensor& screen, const torch::Tensor& seen);
  bool grows(int iteration, int interval) const;
  /// In the place of GaussianModel::densifyAndPrune.
  void densifyAndPrune(int iteration, float min_opacity, float extent, int max_screen_size);
  void pruneLate(int iteration);
  /// Whether opacities are reset now; applies the gradients that wait if so.
  bool resets(int iteration);
  /// Steps the parameter groups whose time has come; the others keep their gradients.
  void step(int iteration);
  /// Applies gradients that wait, before what they belong to changes.
  void applyGradients();

 private:
  struct Parts;
  explicit Boost(std::unique_ptr<Parts> parts);
  std::unique_ptr<Parts> parts_;
};

/// The host's own, where boost is null.
void densifyAndPrune(const std::shared_ptr<Boost>& boost, const std::shared_ptr<GaussianModel>& gaussians,
                     int iteration, float max_grad, float min_opacity, float extent, int max_screen_size);

/// The Gaussians, with no gradients that wait.
const std::shared_ptr<GaussianModel>& settled(const std::shared_ptr<Boost>& boost,
                                              const std::shared_ptr<GaussianModel>& gaussians);

}  // namespace splatboost
