// SPDX-License-Identifier: Apache-2.0
/// @file What the trainer and the program need from a backbone. It knows of hooks, not of what is behind them.
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

/// What a backbone is made of. References outlive the backbone.
struct BackboneContext {
  const Scene& scene;
  Threads& threads;  ///< for what the host does
  std::uint64_t seed = 0;
  int iterations = kPublishedIterations;
  std::size_t max_primitives = 0;  ///< hard cap, never exceeded; 0: none
  Device device = threads;         ///< trains and renders
};

/// The surface that a view shows. Planar images of the camera's size, in memory of the host.
struct SurfaceImages {
  std::span<float> color;  ///< [3,H,W]
  std::span<float> depth;  ///< [H,W] along z, world units; 0: nothing is there
  std::span<float> alpha;  ///< [H,W]
};

class Backbone {
 public:
  virtual ~Backbone() = default;

  /// One iteration (from 1) on one training view: render, loss, backward, steps, density control.
  /// A GPU may still be at work when this returns, so that the host prepares the next iterations.
  /// @return the training loss; on a GPU the newest that is known, of an earlier iteration, except for the last
  /// iteration of the run. Once one was not finite it stays so.
  virtual double train_step(int iteration, const View& view) = 0;

  /// Returns when all iterations are done. On the CPU they are.
  virtual void wait() {}

  /// Applies what the optimizer has accumulated; called once after the last iteration and before a model is exported.
  virtual void finish() = 0;

  virtual std::size_t primitives() const = 0;

  /// Memory that a primitive takes while it trains, for the estimate before a run: about.
  virtual std::size_t bytes_per_primitive() const { return gaussian_memory_bytes(); }

  /// Renders as trained (hook's box), or with a compact box of `beta`.
  /// @param color [3,H,W] of the camera's size, in memory of the host
  virtual void render(const Camera& camera, float time, std::optional<float> beta, std::span<float> color) = 0;

  /// Whether what is rendered depends on the time.
  virtual bool uses_time() const { return false; }

  /// Writes the Gaussians as they are drawn at a time, in the standard .ply, for viewers that know no time. Throws
  /// InputError where the backbone has none to write.
  virtual void export_moment(float time, const std::filesystem::path& file);

  /// Whether it knows surfaces.
  virtual bool has_surfaces() const { return false; }
  /// Whether surfaces are part of what it is trained for, so that pictures of them belong into its report.
  virtual bool trains_surfaces() const { return false; }
  /// Renders as render() does, with the depth of what is there; only where has_surfaces().
  virtual void render_surface(const Camera& camera, float time, std::optional<float> beta,
                              const SurfaceImages& images) {
    (void)camera, (void)time, (void)beta, (void)images;
  }

  /// Writes the model into `folder` (for Gaussians: point_cloud.ply). @return bytes written
  virtual std::uint64_t export_model(const std::filesystem::path& folder) const = 0;
  /// Reads what export_model() wrote.
  virtual void import_model(const std::filesystem::path& folder) = 0;

  /// Everything that training needs to go on: loading and continuing gives the bytes of an uninterrupted run.
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
