// SPDX-License-Identifier: Apache-2.0
/// @file SplatBoost in Photo-SLAM: replaces the host's rasterizer and density control, through the C ABI of
/// libsplatboost. Written by `splatboost patch apply photo-slam`; `splatboost patch revert` removes it.
///
/// A Boost is used by the mapper's thread only; the mapper and the viewer may both draw, but not at the same time. On a
/// GPU it runs on the default stream, as the host does.
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

/// Draws a model. A model without one is drawn by the host's own rasterizer.
class Drawing;

/// Replaces GaussianRasterizer::forward, with the same arguments and results.
std::tuple<torch::Tensor, torch::Tensor> draw(const std::shared_ptr<Drawing>& drawing, GaussianRasterizer& host,
                                              torch::Tensor means3D, torch::Tensor means2D, torch::Tensor opacities,
                                              bool has_shs, bool has_colors, bool has_scales, bool has_rotations,
                                              bool has_covariances, torch::Tensor shs, torch::Tensor colors,
                                              torch::Tensor scales, torch::Tensor rotations, torch::Tensor covariances);

/// The method's decisions in an iteration of the mapper. Errors of the library are thrown as std::runtime_error.
class Boost {
 public:
  /// The parts of the mapper that are read; all of them must outlive the Boost.
  struct Host {
    std::shared_ptr<GaussianModel> gaussians;
    std::shared_ptr<GaussianScene> scene;
    const GaussianOptimizationParams& optimization;
    GaussianPipelineParams& pipeline;
    torch::Tensor& background;
    const std::map<std::uint32_t, torch::Tensor>& masks;  ///< float [3,H,W] per camera: 1 where a pixel is valid
    bool online;                                          ///< keyframes arrive during training
  };

  /// Reads these optional keys from the mapper's settings file: SplatBoost.on (default 1; with 0 this returns null),
  /// SplatBoost.max_gaussians (0: no cap), SplatBoost.literal, and any setting of the adapter photo-slam, such as
  /// SplatBoost.beta and SplatBoost.tau_d. An invalid one ends the process with status 2 and one line that names it.
  static std::shared_ptr<Boost> make(const std::filesystem::path& settings, const Host& host);
  ~Boost();

  /// Adds a view's gradients to the statistics. @param screen [N,3] with its gradient @param seen bool [N]
  void gather(const torch::Tensor& screen, const torch::Tensor& seen);
  bool grows(int iteration, int interval) const;
  /// Replaces GaussianModel::densifyAndPrune.
  void densifyAndPrune(int iteration, float min_opacity, float extent, int max_screen_size);
  void pruneLate(int iteration);
  /// Whether opacities are reset now; if so, applies the pending gradients.
  bool resets(int iteration);
  /// Steps the parameter groups that are due; the others keep their gradients.
  void step(int iteration);
  /// Applies pending gradients; call it before the parameters that they belong to change.
  void applyGradients();
  /// Forgets the statistics, which are of the map before the correction, and prunes nothing for 100 iterations.
  void loopClosed(int iteration);

 private:
  struct Parts;
  explicit Boost(std::unique_ptr<Parts> parts);
  std::unique_ptr<Parts> parts_;
};

/// Calls the host's own densifyAndPrune if boost is null.
void densifyAndPrune(const std::shared_ptr<Boost>& boost, const std::shared_ptr<GaussianModel>& gaussians,
                     int iteration, float max_grad, float min_opacity, float extent, int max_screen_size);

/// The Gaussians, after their pending gradients are applied.
const std::shared_ptr<GaussianModel>& settled(const std::shared_ptr<Boost>& boost,
                                              const std::shared_ptr<GaussianModel>& gaussians);

}  // namespace splatboost
