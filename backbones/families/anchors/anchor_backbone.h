// SPDX-License-Identifier: Apache-2.0
/// @file Base class for training anchors: the common part of Scaffold-GS and Octree-GS. A derived backbone defines the
/// initial anchors, which of them a view may use, and where new ones grow.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "families/anchors/anchor_config.h"
#include "families/anchors/anchor_view.h"
#include "families/anchors/slot_statistics.h"
#include "splatboost/array.h"
#include "splatboost/rasterizer.h"
#include "trainer/backbone_api/backbone.h"
#include "trainer/backbone_api/trained_group.h"
#include "trainer/backbone_api/training_truths.h"

namespace splatboost {

/// Anchor positions are not trained: their published learning rate is 0. The program counts anchors as primitives; for
/// hooks a primitive is a slot, with index anchor·k + offset.
///
/// Tensors are in device memory. Positions and side rows change in growth only and are in host memory; growth is
/// decided on the host.
class AnchorBackbone : public Backbone {
 public:
  double train_step(int iteration, const View& view) override;
  void wait() override {
    if (device_.is_cuda()) device_.stream().synchronize();
  }
  void finish() override {
    step_all();
    if (take_averages(groups_)) parameters_moved();
    wait();
  }
  std::size_t primitives() const override { return positions_.size() / 3; }
  std::size_t bytes_per_primitive() const override;
  void render(const Camera& camera, float time, std::optional<float> beta, std::span<float> color) override;
  bool has_surfaces() const override { return true; }
  void render_surface(const Camera& camera, float time, std::optional<float> beta,
                      const SurfaceImages& images) override;
  std::uint64_t export_model(const std::filesystem::path& folder) const override;
  void import_model(const std::filesystem::path& folder) override;
  void save(ArchiveWriter& archive) const override;
  void load(ArchiveReader& archive) override;
  RasterizerHook& rasterizer_hook() override { return slots_hook_; }
  void set_hooks(DensityHook* density, OptimizerHook* optimizer) override {
    density_ = density;
    optimizer_ = optimizer;
  }
  const StageClock& stages() const override { return clock_; }

 protected:
  /// A per-anchor value besides the parameters: its name in files, and the values [N].
  struct SideRow {
    std::string name;
    std::vector<float>* values;
  };
  /// A scalar of the model that is stored in files.
  struct Constant {
    std::string name;
    float* value;
  };

  /// @param published_iterations length of the published run, to which iterations in `config` refer
  AnchorBackbone(const BackboneContext& context, const AnchorConfig& config, const DecoderShape& shape,
                 int published_iterations);

  /// To be called once by derived constructors. The size of an anchor is the root of the mean squared distance to its
  /// three nearest neighbours; a cap keeps an even subset.
  /// @param positions [N,3]
  void set_anchors(std::span<const float> positions);
  /// Registers per-anchor values of a derived class, which are then kept in step with the anchors. To be called before
  /// set_anchors().
  void add_side_row(SideRow row) { side_rows_.push_back(std::move(row)); }
  void add_constant(Constant constant) { constants_.push_back(std::move(constant)); }

  /// Called before the next view after anchors, side rows or constants changed: copies what the device needs of them
  /// there.
  virtual void anchors_changed() {}
  /// [N] zero where this view may not use an anchor, in device memory; empty: it may use all.
  virtual std::span<const std::uint8_t> usable_anchors(const Camera& camera) {
    (void)camera;
    return {};
  }
  /// See AnchorView::forget_views(). To be called when the share of usable anchors per view changes.
  void forget_views() { view_.forget_views(); }
  /// [N] levels for DecoderShape::level, in device memory.
  virtual std::span<const float> levels() const { return {}; }
  /// The backbone's own rule: marks the slots that grow, [N·k]. @param judged slots seen often enough
  virtual void choose_growing(std::span<const float> gradients, std::span<const std::uint8_t> judged,
                              std::span<std::uint8_t> growing) = 0;
  /// Adds anchors at the slots that grow.
  virtual void grow(std::span<const float> gradients, std::span<const std::uint8_t> growing) = 0;

  /// Appends anchors; if the cap does not admit all, the most important ones. Side rows are zero.
  /// @param positions [C,3]; @param features [C,F]; @param importance [C]
  /// @return number of anchors added: they are the last rows, in the given order
  std::size_t append_anchors(std::span<const float> positions, float log_size, std::span<const float> features,
                             std::span<const float> importance);
  std::size_t slots_per_anchor() const { return shape_.offsets; }
  std::span<const float> positions() const { return positions_; }
  /// The same in device memory.
  std::span<const float> positions_on_device() const;

  // Valid within grow(), for the anchors present when it was called:
  /// World position of a slot's Gaussian.
  std::array<float, 3> slot_position(std::size_t slot) const;
  std::span<const float> anchor_feature(std::size_t anchor) const;
  int at(int published) const;
  int iteration() const { return iteration_; }
  const BackboneContext& context() const { return context_; }
  /// World units per length unit of the settings.
  double unit() const { return unit_; }

 private:
  /// Rasterizer operations that adapters may call. Primitives are slots.
  class SlotsHook final : public RasterizerHook {
   public:
    explicit SlotsHook(AnchorBackbone& owner) : owner_(owner) {}
    void set_beta(std::optional<float> beta) override { owner_.beta_ = beta; }
    std::size_t primitives() const override { return owner_.primitives() * owner_.shape_.offsets; }
    std::size_t scorable_views() const override { return owner_.context_.scene.train.size(); }
    ScoredView render_for_score(std::size_t view) override;
    void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override;

   private:
    AnchorBackbone& owner_;
    Array<std::int32_t> view_counts_{owner_.device_};
  };

  std::vector<TrainedGroup*> anchor_groups() { return {&offsets_, &features_, &scaling_}; }
  /// A learning rate that decays exponentially over the run.
  std::function<double(int)> falling(double initial, double final_value) const;
  void step_all();
  void parameters_moved();
  void activate();
  DecoderInputs<float> decoder_inputs() const;
  void use_embedding_of(const View* view);
  /// Decodes for a camera that is not known to be a training view's.
  void decode_for(const Camera& camera);
  void decode(const Camera& camera, bool ahead);
  Gaussians gaussians() const;
  void draw(const Camera& camera, std::optional<float> beta, const RasterImages& images);
  void draw(const Camera& camera, std::optional<float> beta, std::span<float> color);
  void change_anchors();
  void remove_anchors(std::span<const std::uint8_t> removed);
  std::vector<std::string> model_columns() const;
  Moment moment() const { return {iteration_, context_.iterations}; }

  BackboneContext context_;
  AnchorConfig config_;
  DecoderShape shape_;
  int published_iterations_;
  double unit_;
  Device device_;
  Rasterizer rasterizer_;
  Photometric photometric_;
  AnchorView view_;
  SlotStatistics statistics_;
  SlotsHook slots_hook_{*this};
  std::optional<float> beta_;
  DensityHook* density_ = nullptr;
  OptimizerHook* optimizer_ = nullptr;
  StageClock clock_{device_};
  int iteration_ = 0;

  std::vector<float> positions_;            ///< [N,3]
  Array<float> device_positions_{device_};  ///< copy on a GPU
  // Group names are those of Scaffold-GS.
  TrainedGroup offsets_, features_, scaling_, opacity_net_, cov_net_, color_net_, bank_net_;
  TrainedGroup embedding_;             ///< one row per training view
  std::vector<TrainedGroup*> groups_;  ///< those of the above in use
  std::vector<SideRow> side_rows_;
  std::vector<Constant> constants_;

  bool stale_ = true;                       ///< parameters changed since activate()
  bool anchors_changed_ = true;             ///< anchors, side rows or constants changed since activate()
  Array<float> scales_{device_};            ///< [N,6] exp of scaling_
  std::span<const float> view_embedding_;   ///< of the view being decoded
  Array<float> mean_embedding_{device_};    ///< for views without their own; empty: not computed
  const ViewGaussians* decoded_ = nullptr;  ///< result of the last decode()
  Array<float> image_{device_}, image_gradient_{device_}, screen_{device_};
  /// Gradients of the view's Gaussians.
  struct {
    Array<float> means, scales, rotations, opacities, colors;
  } gaussian_gradients_{Array<float>(device_), Array<float>(device_), Array<float>(device_), Array<float>(device_),
                        Array<float>(device_)};
  TrainingTruths truths_{context_.scene, device_};

  // For growth, which is decided on the host.
  struct OnHost {
    std::vector<float> offsets, features, scales;
  };
  OnHost on_host_;  ///< copies of tensors in device memory
  std::vector<float> mean_gradients_;
  std::vector<std::uint8_t> judged_, growing_, removed_;
};

}  // namespace splatboost
