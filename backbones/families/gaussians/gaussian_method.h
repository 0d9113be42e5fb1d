// SPDX-License-Identifier: Apache-2.0
/// @file What one backbone of explicit Gaussians does differently from 3DGS.
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
  bool clamped = false;  ///< of the image cut at 1, where no gradient passes; scores are of that image too
};

/// What the loss of a training step reads besides the colour of its view.
struct LossInputs {
  bool inverse_depth = false;
  bool alpha = false;
  bool features = false;         ///< those that draw() gives the Gaussians
  const View* second = nullptr;  ///< another view that is drawn in this step too; null: none. Without a photo: no truth
  bool second_color = true;      ///< whether the loss reads the colour of that one
};

/// Stages that draw() and add_gradients() are timed as, literals; null: of what is around them.
struct MethodStages {
  const char* draw = nullptr;
  const char* add_gradients = nullptr;
};

/// A view of a training step as it was drawn, in memory of the device.
struct StepView {
  DrawContext context;
  TruthImage truth;
  RasterImages images;                    ///< colour and what LossInputs names, to be read
  RasterImages gradients;                 ///< of the loss, with respect to these, to be added to
  std::span<const std::uint8_t> visible;  ///< [N] Gaussians, as Rasterizer::visible() says
};

/// Draws training views apart from steps, as they are scored.
class ViewDrawer {
 public:
  virtual ~ViewDrawer() = default;
  virtual std::size_t views() const = 0;
  /// @return what drew it, for counts and radii; valid until the next view
  virtual Rasterizer& draw(std::size_t view) = 0;
};

/// The points where a backbone may vary; the trainer (gaussian_backbone.h) does the rest. Defaults are 3DGS.
/// Spans have one row a Gaussian, activated, in memory of the backbone's device, and are valid during the call. Those
/// of add_growing() and trim() are of the host.
class GaussianMethod {
 public:
  virtual ~GaussianMethod() = default;

  /// As the program, messages and checkpoints call it.
  virtual std::string_view name() const = 0;
  /// All settings in use, as --config takes them.
  virtual nlohmann::json config() const = 0;

  /// Of the view that a step is given. A scale of 0: not at all, add_loss() is the whole loss.
  virtual LossForm loss() const = 0;
  /// @param first the view that the step is given
  virtual LossInputs loss_inputs(const DrawContext& first) {
    (void)first;
    return {};
  }
  /// Adds the gradients of its own terms. Those of a second view go to the parameters too, but not to the statistics of
  /// density control.
  /// @param views the first, and the second if there is one
  /// @return the sum of its terms; on a GPU the newest that is known, and one that is not finite stays
  virtual double add_loss(std::span<const StepView> views) {
    (void)views;
    return 0;
  }
  virtual MethodStages stages() const { return {}; }
  /// Memory of its own that a Gaussian takes while it trains, groups excluded.
  virtual std::size_t bytes_per_gaussian() const { return 0; }
  /// Low-pass, compensation, near plane. Box and background are the trainer's.
  virtual RasterOptions raster_options() const { return {}; }

  // Parameters of its own, besides 3DGS's six groups.

  /// The same at every call, which live as long as the method. add_gradients() adds to their gradients and sets
  /// `pending`; a group that is not pending does not step.
  virtual std::vector<TrainedGroup*> groups() { return {}; }
  /// The Gaussians that a run starts from: gives its groups of rows a row each and its dense ones their values. Comes
  /// once, also before a checkpoint or a model is read into them.
  virtual void start(std::span<const float> means) { (void)means; }

  /// Whether what is drawn depends on the view's time.
  virtual bool uses_time() const { return false; }

  // Drawing. What is drawn may differ from what is activated (by a filter, dropout, motion); the method owns the
  // difference. Density control reads what is activated.

  /// Gaussians were added, removed or numbered anew, or renews_at() asked for it. Called before activated().
  virtual void gaussians_changed(std::span<const float> means) { (void)means; }
  /// Whether gaussians_changed() shall be called at the end of this iteration even if they did not.
  virtual bool renews_at(Moment moment) const {
    (void)moment;
    return false;
  }
  /// Scales and opacities have new values.
  virtual void activated(std::span<const float> scales, std::span<const float> opacities) {
    (void)scales;
    (void)opacities;
  }
  /// May put other means, scales, rotations, opacities and colours, and features, in memory of its own, into what is
  /// drawn. That memory keeps its values until the next draw(). `drawn` comes with the activated ones. A view may be
  /// drawn twice in a step (a second one is, for its backward pass): both are the same.
  virtual void draw(Gaussians& drawn, const DrawContext& context) {
    (void)drawn;
    (void)context;
  }
  /// Before the backward pass of the training view drawn last: lets gradients of whatever draw() replaced go to memory
  /// of its own, zeroed (they are added) …
  virtual void redirect(GaussianGradients& gradients) { (void)gradients; }
  /// … and afterwards adds what came there to the gradients of the activated ones.
  virtual void add_gradients(const GaussianGradients& activated) { (void)activated; }

  // What others see of a drawing.

  /// May change the image of a training view before it is scored (by the view's exposure).
  /// @param color [3,H,W]
  virtual void compensate(std::span<float> color, const View& view) {
    (void)color;
    (void)view;
  }
  /// Depth along z of the surface that a view shows, 0 where nothing is, from what was drawn for
  /// DrawPurpose::surface.
  /// @param features [F,H,W] those that draw() gave the Gaussians
  /// @param depth [H,W] of the device
  /// @return whether it knows better than the inverse of the mean inverse depth
  virtual bool surface_depth(std::span<const float> features, const Camera& camera, std::span<float> depth) {
    (void)features, (void)camera, (void)depth;
    return false;
  }
  /// Whether the loss is of surfaces too.
  virtual bool trains_surfaces() const { return false; }

  // Density control.

  virtual bool needs_absolute_gradients() const { return false; }
  /// Whether the threshold is of the mean absolute gradient in place of the signed one.
  virtual bool grows_by_absolute_gradients() const { return false; }
  virtual AbsoluteNorm absolute_norm() const { return AbsoluteNorm::euclidean; }
  /// How many views one view stands for in which a Gaussian was listed in a tile.
  virtual float views_seen(bool compact_box) const {
    (void)compact_box;
    return 1;
  }
  /// Adds Gaussians to those that grow since their mean gradient reaches the threshold.
  /// @param priorities [N] of all Gaussians under a cap; those that are added get theirs (growth_priority())
  virtual void add_growing(const DensityStatistics& statistics, std::span<std::uint8_t> growing,
                           std::span<float> priorities) const {
    (void)statistics;
    (void)growing;
    (void)priorities;
  }
  /// Statistics of its own, after the backward pass of the view that a step is given, while Gaussians may grow.
  /// @param rasterizer that drew it
  virtual void gather(Rasterizer& rasterizer) { (void)rasterizer; }
  /// Those statistics begin anew. @param count Gaussians that there are now
  virtual void restart_statistics(std::size_t count) { (void)count; }
  /// Whether clones are placed at a point of their Gaussian's distribution, instead of at its mean.
  virtual bool scatters_clones() const { return false; }
  /// Whether Gaussians go at this moment by a rule of the method's apart from that of growth.
  virtual bool trims_at(Moment moment) const {
    (void)moment;
    return false;
  }
  /// Says which. Views may be drawn for it. @param remove [N] of the host, zero
  virtual void trim(const DensityStatistics& statistics, ViewDrawer& views, std::span<std::uint8_t> remove) {
    (void)statistics;
    (void)views;
    (void)remove;
  }
  // A set that grows and moves from outside of density control (a mapper's), in a run whose end is not known.

  /// At the beginning of every iteration, before its view is drawn: may insert Gaussians and move them.
  virtual void edit(GaussianSet& set, int iteration) {
    (void)set;
    (void)iteration;
  }
  /// Clears those that stay whatever a hook has decided; not asked where there is no hook. @param remove [N] of the
  /// host
  virtual void spare(Moment moment, PruneRule rule, std::span<std::uint8_t> remove) {
    (void)moment;
    (void)rule;
    (void)remove;
  }
  /// The length of the run as far as it is known at this iteration; schedules and hooks see shares of it.
  /// @param given as the run was asked for
  virtual int planned_iterations(int iteration, int given) const {
    (void)iteration;
    return given;
  }
  /// How far the rate of positions has fallen (a mapper's falls with the uses of a view).
  virtual Moment position_rate_moment(Moment run) const { return run; }

  /// [N] drawn over activated opacity, for the reset of opacities; empty: 1.
  virtual std::span<const float> opacity_factors() const { return {}; }

  // Files: what the method keeps a Gaussian beyond parameters. Its groups are saved by the trainer, in models as
  // parameters.bin.

  virtual void save(ArchiveWriter& archive) const { (void)archive; }
  /// Throws InputError unless the archive holds `count` rows.
  virtual void load(const ArchiveReader& archive, std::size_t count) {
    (void)archive;
    (void)count;
  }
  virtual void export_to(SplatCloud& cloud) const { (void)cloud; }
  /// @return whether the model held it; if not, gaussians_changed() is called
  virtual bool import_from(const SplatCloud& cloud) {
    (void)cloud;
    return false;
  }
};

}  // namespace splatboost
