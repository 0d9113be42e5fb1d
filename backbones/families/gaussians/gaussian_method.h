// SPDX-License-Identifier: Apache-2.0
/// @file Interface for what a backbone of explicit Gaussians does differently from 3DGS.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "families/gaussians/gaussian_set.h"
#include "splatboost/density_statistics.h"
#include "splatboost/gaussians.h"
#include "splatboost/hooks.h"
#include "splatboost/rasterizer.h"
#include "trainer/backbone_api/draw_context.h"
#include "trainer/backbone_api/trained_group.h"
#include "trainer/dataset/splat_ply.h"
#include "trainer/support/archive.h"

namespace splatboost {

/// scale · ((1 − λ)·L1 + λ·(1 − SSIM))
struct LossForm {
  float lambda_dssim = 0.2f;
  float scale = 1;
  bool clamped = false;  ///< clamp the image to at most 1, without gradient there; applies to scored images too
};

/// Inputs of a training step's loss besides the colour of its view.
struct LossInputs {
  bool inverse_depth = false;
  bool alpha = false;
  bool features = false;         ///< those that draw() assigns to the Gaussians
  const View* second = nullptr;  ///< a second view to render in this step, with an empty truth if it has no photo
  bool second_color = true;      ///< whether the second view is rendered in colour
};

/// Stage names (string literals) for timing draw() and add_gradients(); null: counted in the enclosing stage.
struct MethodStages {
  const char* draw = nullptr;
  const char* add_gradients = nullptr;
};

/// A view as rendered in a training step, in device memory.
struct StepView {
  DrawContext context;
  TruthImage truth;
  RasterImages images;                    ///< colour and the images that LossInputs requests; read only
  RasterImages gradients;                 ///< gradients of the loss with respect to `images`; add to them
  std::span<const std::uint8_t> visible;  ///< [N] see Rasterizer::visible()
};

/// Passes training views through the rasterizer outside of training steps.
class ViewDrawer {
 public:
  virtual ~ViewDrawer() = default;
  virtual std::size_t views() const = 0;
  /// Renders no image, for counts and radii. @return the rasterizer that did; valid until the next view
  virtual Rasterizer& draw(std::size_t view) = 0;
};

/// Customisation points of a backbone; the trainer (gaussian_backbone.h) does the rest. Defaults are 3DGS.
/// Spans have one row per Gaussian, hold activated values, are in memory of the backbone's device and are valid during
/// the call. Spans of add_growing(), trim() and spare() are in host memory.
class GaussianMethod {
 public:
  virtual ~GaussianMethod() = default;

  /// Name used by the program, in messages and in checkpoints.
  virtual std::string_view name() const = 0;
  /// All settings in use, in the format of --config.
  virtual nlohmann::json config() const = 0;

  /// Photometric loss of the step's view. A scale of 0 disables it: add_loss() is then the whole loss.
  virtual LossForm loss() const = 0;
  /// @param first the step's view
  virtual LossInputs loss_inputs(const DrawContext& first) {
    (void)first;
    return {};
  }
  /// Adds the gradients of the method's own loss terms. Gradients of a second view reach the parameters, but not the
  /// statistics of density control.
  /// @param views the first, and the second if there is one
  /// @return the sum of these terms; on a GPU the latest known sum; once not finite, it stays not finite
  virtual double add_loss(std::span<const StepView> views) {
    (void)views;
    return 0;
  }
  virtual MethodStages stages() const { return {}; }
  /// The method's own memory per Gaussian during training, in bytes, without its groups.
  virtual std::size_t bytes_per_gaussian() const { return 0; }
  /// The same per pixel of a view.
  virtual std::size_t bytes_per_pixel() const { return 0; }
  /// Low-pass filter, compensation, near plane. The trainer sets box and background.
  virtual RasterOptions raster_options() const { return {}; }

  // The method's own parameters, besides the six groups of 3DGS.

  /// The same groups at every call; they live as long as the method. add_gradients() adds to their gradients and sets
  /// `pending`; a group that is not pending does not step.
  virtual std::vector<TrainedGroup*> groups() { return {}; }
  /// Initialises the method's groups for the initial Gaussians: one row per Gaussian in row groups, values in dense
  /// groups. Called once, also if a checkpoint or a model is read into them afterwards.
  virtual void start(std::span<const float> means) { (void)means; }

  /// Whether renders depend on the view's time.
  virtual bool uses_time() const { return false; }

  // Rendering. The rendered Gaussians may differ from the activated ones (filter, dropout, motion); the method handles
  // the difference. Density control reads the activated ones.

  /// Called when Gaussians were added, removed or reordered, or renews_at() requested it; before activated().
  virtual void gaussians_changed(std::span<const float> means) { (void)means; }
  /// Whether to call gaussians_changed() at the end of this iteration even if the Gaussians did not change.
  virtual bool renews_at(Moment moment) const {
    (void)moment;
    return false;
  }
  /// Called when scales and opacities have new values.
  virtual void activated(std::span<const float> scales, std::span<const float> opacities) {
    (void)scales;
    (void)opacities;
  }
  /// May replace means, scales, rotations, opacities and colours in `drawn`, which holds the activated ones on entry,
  /// and set features. These spans are in the method's memory and must keep their values until the next draw(). A view
  /// may be drawn twice in a step (a second view is, for its backward pass); both calls must give the same result.
  virtual void draw(Gaussians& drawn, const DrawContext& context) {
    (void)drawn;
    (void)context;
  }
  /// Called before the backward pass of the training view drawn last: directs the gradients of what draw() replaced to
  /// memory of the method, which must be zeroed because gradients are accumulated. Those of higher SH bands are in
  /// sh_factors or in sh_rest, and must stay there.
  virtual void redirect(GaussianGradients& gradients) { (void)gradients; }
  /// Called after the backward pass: adds the redirected gradients to the gradients of the activated values.
  virtual void add_gradients(const GaussianGradients& activated) { (void)activated; }

  // Postprocessing of renders.

  /// May change the render of a training view before it is scored (for example by the view's exposure).
  /// @param color [3,H,W]
  virtual void compensate(std::span<float> color, const View& view) {
    (void)color;
    (void)view;
  }
  /// Computes the depth along z of the surface in a view, 0 where there is none, from what was rendered for
  /// DrawPurpose::surface.
  /// @param features [F,H,W] rendered features that draw() assigned to the Gaussians
  /// @param depth [H,W] in device memory
  /// @return whether depth was computed; if not, the inverse of the mean inverse depth is used
  virtual bool surface_depth(std::span<const float> features, const Camera& camera, std::span<float> depth) {
    (void)features, (void)camera, (void)depth;
    return false;
  }
  /// As Backbone::photo_scale().
  virtual double photo_scale() const { return 1; }
  /// Whether the loss has terms for surfaces.
  virtual bool trains_surfaces() const { return false; }

  // Density control.

  virtual bool needs_absolute_gradients() const { return false; }
  /// Whether the growth threshold applies to the mean absolute gradient instead of the signed one.
  virtual bool grows_by_absolute_gradients() const { return false; }
  virtual AbsoluteNorm absolute_norm() const { return AbsoluteNorm::euclidean; }
  /// Number of views that a view counts as in the statistics of the Gaussians visible in it.
  virtual float views_seen(bool compact_box) const {
    (void)compact_box;
    return 1;
  }
  /// May select further Gaussians to grow, besides those whose mean gradient reaches the threshold.
  /// @param growing [N] non-zero: grows
  /// @param priorities [N] which Gaussians grow first under a cap; to be set for those added (growth_priority())
  virtual void add_growing(const DensityStatistics& statistics, std::span<std::uint8_t> growing,
                           std::span<float> priorities) const {
    (void)statistics;
    (void)growing;
    (void)priorities;
  }
  /// Gathers the method's own statistics, after the backward pass of the step's view, while Gaussians may grow.
  /// @param rasterizer the one that rendered the view
  virtual void gather(Rasterizer& rasterizer) { (void)rasterizer; }
  /// Resets these statistics. @param count current number of Gaussians
  virtual void restart_statistics(std::size_t count) { (void)count; }
  /// Whether clones are placed at a sample of their Gaussian's distribution instead of at its mean.
  virtual bool scatters_clones() const { return false; }
  /// Whether the method prunes Gaussians at this moment by a rule of its own, besides the pruning after growth.
  virtual bool trims_at(Moment moment) const {
    (void)moment;
    return false;
  }
  /// Selects the Gaussians to prune; may render views. @param remove [N] zero on entry; non-zero: prune
  virtual void trim(const DensityStatistics& statistics, ViewDrawer& views, std::span<std::uint8_t> remove) {
    (void)statistics;
    (void)views;
    (void)remove;
  }
  // Gaussians inserted and moved outside of density control (by a mapper), in a run of unknown length.

  /// Called at the start of every iteration, before its view is rendered: may insert and move Gaussians.
  virtual void edit(GaussianSet& set, int iteration) {
    (void)set;
    (void)iteration;
  }
  /// Whether Gaussians may be pruned now, given a density hook; if not, the hook is not asked and decides later.
  virtual bool may_prune(Moment moment) const {
    (void)moment;
    return true;
  }
  /// Clears the flags of Gaussians that must be kept whatever the density hook decided; not called without a hook.
  /// @param remove [N] non-zero: prune
  virtual void spare(Moment moment, PruneRule rule, std::span<std::uint8_t> remove) {
    (void)moment;
    (void)rule;
    (void)remove;
  }
  /// The length of the run as known at this iteration; schedules and hooks are relative to it.
  /// @param given the requested number of iterations
  virtual int planned_iterations(int iteration, int given) const {
    (void)iteration;
    return given;
  }
  /// Progress of the decay of the position learning rate (for a mapper it depends on the uses of a view).
  virtual Moment position_rate_moment(Moment run) const { return run; }

  /// [N] ratio of rendered to activated opacity, for the opacity reset; empty: all 1.
  virtual std::span<const float> opacity_factors() const { return {}; }

  // Files: per-Gaussian data of the method besides parameters. The trainer saves its groups, in models as
  // parameters.bin.

  virtual void save(ArchiveWriter& archive) const { (void)archive; }
  /// Throws InputError unless the archive holds `count` rows.
  virtual void load(const ArchiveReader& archive, std::size_t count) {
    (void)archive;
    (void)count;
  }
  virtual void export_to(SplatCloud& cloud) const { (void)cloud; }
  /// @return whether the model contained the data; if not, gaussians_changed() is called
  virtual bool import_from(const SplatCloud& cloud) {
    (void)cloud;
    return false;
  }
};

}  // namespace splatboost
