// SPDX-License-Identifier: Apache-2.0
/// @file Interface of a backbone to the trainer and the program. It knows the hook interfaces, not what implements
/// them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>

#include <nlohmann/json.hpp>

#include "splatboost/device.h"
#include "splatboost/hooks.h"
#include "splatboost/threads.h"
#include "trainer/backbone_api/memory_estimate.h"
#include "trainer/backbone_api/stage_clock.h"
#include "trainer/dataset/scene.h"
#include "trainer/support/archive.h"

namespace splatboost {

/// What a backbone is constructed from. The references must outlive the backbone.
struct BackboneContext {
  const Scene& scene;
  Threads threads;  ///< for work on the host
  std::uint64_t seed = 0;
  int iterations = kPublishedIterations;
  std::size_t max_primitives = 0;  ///< hard cap, never exceeded; 0: none
  Device device = threads;         ///< where training and rendering run
  bool views_arrive = false;       ///< the scene has only the first views yet: an OnlineBackbone is told of others
};

/// The surface seen from a camera: planar images of the camera's size, in host memory.
struct SurfaceImages {
  std::span<float> color;  ///< [3,H,W]
  std::span<float> depth;  ///< [H,W] along z, world units; 0: no surface
  std::span<float> alpha;  ///< [H,W]
};

/// Depth where primitives have no planes: the inverse of the mean inverse depth of what a pixel shows.
/// @param depth [H,W] Σ wᵢ / zᵢ; becomes alpha / Σ wᵢ / zᵢ, 0 where nothing is shown
void depths_of_inverse(std::span<const float> alpha, std::span<float> depth);

class Backbone {
 public:
  virtual ~Backbone() = default;

  /// One iteration (from 1) on one training view: render, loss, backward, steps, density control.
  /// A GPU may still be working when this returns, so that the host can prepare the next iterations.
  /// @return the training loss; on a GPU the latest known one, of an earlier iteration, except in the last iteration of
  /// the run. After a loss that is not finite, the result stays not finite.
  virtual double train_step(int iteration, const View& view) = 0;

  /// Waits until all iterations are done. On the CPU they already are.
  virtual void wait() {}

  /// Applies gradients that are accumulated but not yet applied, and replaces parameters by their averages, if there
  /// are any; called once, after the last iteration and before a model is exported.
  virtual void finish() = 0;

  virtual std::size_t primitives() const = 0;

  /// Approximate memory per primitive during training, in bytes, for the estimate before a run.
  virtual std::size_t bytes_per_primitive() const { return gaussian_memory_bytes(); }
  /// The same per pixel of a view.
  virtual std::size_t bytes_per_pixel() const { return pixel_memory_bytes(); }

  /// Renders with the box of training (RasterizerHook::set_beta()), or with a compact box of `beta` if given.
  /// @param color [3,H,W] of the camera's size, in host memory
  virtual void render(const Camera& camera, float time, std::optional<float> beta, std::span<float> color) = 0;

  /// Whether renders depend on the time.
  virtual bool uses_time() const { return false; }

  /// Writes the Gaussians as drawn at `time` in the standard .ply format, for viewers that do not support time. Throws
  /// InputError if the model does not change with time.
  virtual void export_moment(float time, const std::filesystem::path& file);

  /// Whether render_surface() is implemented.
  virtual bool has_surfaces() const { return false; }
  /// Divisor of the training photos' size for Scene::train_rescaled, which must then be set before the first
  /// train_step(); 1: it is not used.
  virtual double photo_scale() const { return 1; }

  /// Whether it is trained for surfaces, so that its report shows pictures of them.
  virtual bool trains_surfaces() const { return false; }
  /// Renders as render() does, with depth and alpha of the surface; call only if has_surfaces().
  virtual void render_surface(const Camera& camera, float time, std::optional<float> beta,
                              const SurfaceImages& images) {
    (void)camera, (void)time, (void)beta, (void)images;
  }

  /// Writes the model into `folder` (for Gaussians: point_cloud.ply). @return bytes written
  virtual std::uint64_t export_model(const std::filesystem::path& folder) const = 0;
  /// Reads what export_model() wrote.
  virtual void import_model(const std::filesystem::path& folder) = 0;

  /// Everything needed to resume training: a resumed run gives the same bytes as an uninterrupted one.
  virtual void save(ArchiveWriter& archive) const = 0;
  virtual void load(ArchiveReader& archive) = 0;

  /// All constants in use, as --config takes them.
  virtual nlohmann::json config() const = 0;

  virtual RasterizerHook& rasterizer_hook() = 0;
  /// Either may be null (the published behaviour). Not owned.
  virtual void set_hooks(DensityHook* density, OptimizerHook* optimizer) = 0;

  virtual const StageClock& stages() const = 0;
};

}  // namespace splatboost
