// SPDX-License-Identifier: Apache-2.0
/// @file The trainer behind make_gaussian_backbone(). Implemented in
/// gaussian_trainer.cpp: activation, rendering, the training step; gaussian_set.cpp: initialisation, insertion, motion
/// and removal of Gaussians; gaussian_density.cpp: density control; gaussian_files.cpp: models and checkpoints.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "families/gaussians/gaussian_backbone.h"
#include "families/gaussians/gaussian_set.h"
#include "families/gaussians/sh_rest_group.h"
#include "splatboost/array.h"
#include "splatboost/density_statistics.h"
#include "splatboost/random.h"
#include "splatboost/rasterizer.h"
#include "trainer/backbone_api/training_truths.h"

namespace splatboost {

inline constexpr int kMinGrowthsAReset = 5;

inline float logit(double p) { return static_cast<float>(std::log(p / (1 - p))); }

/// Parameters of new Gaussians.
struct NewRows {
  std::vector<std::uint32_t> points;  ///< index of the point of each
  std::vector<float> means, dc, log_scales, rotations;
};

class GaussianTrainer final : public Backbone, private RasterizerHook, private ViewDrawer, private GaussianSet {
 public:
  GaussianTrainer(const BackboneContext& context, const GaussianConfig& config, std::unique_ptr<GaussianMethod> method)
      : context_(context),
        config_(config),
        method_(std::move(method)),
        device_(context.device),
        rasterizer_(device_),
        photometric_(device_) {
    initialise();
  }

  double train_step(int iteration, const View& view) override;
  void wait() override {
    if (device_.is_cuda()) device_.stream().synchronize();
  }
  void finish() override {
    step_all();
    if (take_averages(groups_)) stale_ = true;
    activate();
    wait();
  }
  std::size_t primitives() const override { return opacity_.rows(); }
  std::size_t bytes_per_primitive() const override;
  std::size_t bytes_per_pixel() const override { return pixel_memory_bytes() + method_->bytes_per_pixel(); }
  void render(const Camera& camera, float time, std::optional<float> beta, std::span<float> color) override;
  bool uses_time() const override { return method_->uses_time(); }
  void export_moment(float time, const std::filesystem::path& file) override;
  bool has_surfaces() const override { return true; }
  double photo_scale() const override { return method_->photo_scale(); }
  bool trains_surfaces() const override { return method_->trains_surfaces(); }
  void render_surface(const Camera& camera, float time, std::optional<float> beta,
                      const SurfaceImages& images) override;
  std::uint64_t export_model(const std::filesystem::path& folder) const override;
  void import_model(const std::filesystem::path& folder) override;
  void save(ArchiveWriter& archive) const override;
  void load(ArchiveReader& archive) override;
  nlohmann::json config() const override { return method_->config(); }
  RasterizerHook& rasterizer_hook() override { return *this; }
  void set_hooks(DensityHook* density, OptimizerHook* optimizer) override {
    density_ = density;
    optimizer_ = optimizer;
  }
  const StageClock& stages() const override { return clock_; }

 private:
  // RasterizerHook
  void set_beta(std::optional<float> beta) override { beta_ = beta; }
  std::size_t scorable_views() const override { return context_.scene.train.size(); }
  ScoredView render_for_score(std::size_t view) override;
  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    rasterizer_.count_flagged(flagged, counts);
  }
  void add_weights(std::span<std::int32_t> weights) override { rasterizer_.add_weights(weights); }

  // ViewDrawer
  std::size_t views() const override { return context_.scene.train.size(); }
  Rasterizer& draw(std::size_t view) override;

  // GaussianSet
  std::size_t size() const override { return opacity_.rows(); }
  std::vector<float> means() const override { return xyz_.values.to_host(); }
  std::vector<std::uint32_t> insert(const PointCloud& points) override;
  void transform(std::span<const std::int32_t> which, std::span<const Similarity> transforms) override;

  void initialise();
  /// Gaussians for at most `most` of the points, an even subset.
  NewRows rows_of(const PointCloud& points, std::size_t most) const;
  void activate();
  Gaussians activated() const;
  /// The Gaussians passed to the rasterizer.
  Gaussians drawn(const DrawContext& context);
  RasterOptions raster_options(std::optional<float> beta) const;
  int at(int published) const { return scaled_iteration(published, total(), config_.published_iterations); }
  /// Length of the run as currently known.
  int total() const { return method_->planned_iterations(iteration_, context_.iterations); }
  /// Scaled like all phases, with a minimum: opacities need time to recover in short runs.
  int opacity_reset_interval() const {
    return std::max(at(config_.opacity_reset_interval), kMinGrowthsAReset * config_.densify_interval);
  }
  int sh_degree(int iteration) const { return std::min(config_.sh_degree, iteration / at(config_.sh_interval)); }
  double position_rate(int iteration) const {
    const double scale =
        config_.position_rate_scale > 0 ? config_.position_rate_scale : static_cast<double>(context_.scene.extent);
    const int until = config_.position_rate_until > 0 ? at(config_.position_rate_until) : total();
    const Moment fall = method_->position_rate_moment({iteration, until});
    return scale *
           exponential_rate(config_.position_rate_initial, config_.position_rate_final, fall.iteration, fall.total);
  }
  Moment moment() const { return {iteration_, total()}; }
  bool needs_absolute_gradients() const {
    return method_->needs_absolute_gradients() || method_->grows_by_absolute_gradients() ||
           (density_ != nullptr && density_->needs_absolute_gradients());
  }
  /// Groups of the method that are part of models.
  std::vector<TrainedGroup*> model_groups() const {
    std::vector<TrainedGroup*> kept;
    for (std::size_t i = own_groups_.size(); i < groups_.size(); ++i) {
      if (groups_[i]->in_model) kept.push_back(groups_[i]);
    }
    return kept;
  }
  std::string entry(const char* what) const { return std::string(method_->name()) + "." + what; }

  StepView draw_second(const View& view, int iteration, const LossInputs& inputs);
  /// @return the loss; writes its gradients to StepView::gradients
  double evaluate_loss(std::span<const StepView> views);
  /// Whether the coefficients of higher SH bands step in this iteration or within the next few.
  bool rest_steps_soon() const;
  /// Adds a view's gradients to those of the parameters.
  /// @param gradients destination of the screen gradients for density control
  void backward(Rasterizer& rasterizer, const Gaussians& gaussians, const RasterImages& image_gradients,
                GaussianGradients gradients);
  void step_all();

  void control_density();
  DensityStatistics statistics();
  std::span<const float> clearances();
  void grow();
  void prune(PruneRule rule);
  void append_children(std::span<const std::uint32_t> parents);
  /// One sample of each Gaussian's distribution, relative to its mean. @param scales [n,3] @param rotations [n,4]
  static std::vector<float> scattered(std::span<const float> scales, std::span<const float> rotations,
                                      const RandomStream& random, std::uint64_t first_number);
  void remove(std::span<const std::uint8_t> removed);
  void select(const Array<std::uint32_t>& rows);
  void reset_opacities();
  void reorder();
  void restart_statistics();
  ScreenGradientSums gradient_sums() { return {gradient_sum_, gradient_abs_sum_, seen_}; }

  BackboneContext context_;
  GaussianConfig config_;
  std::unique_ptr<GaussianMethod> method_;
  Device device_;
  Rasterizer rasterizer_;
  Photometric photometric_;
  std::optional<float> beta_;
  DensityHook* density_ = nullptr;
  OptimizerHook* optimizer_ = nullptr;
  StageClock clock_{device_};
  int iteration_ = 0;

  // Group names are those of 3DGS.
  TrainedGroup xyz_{"xyz", 3, device_, [this](int iteration) { return position_rate(iteration); }};
  TrainedGroup f_dc_{"f_dc", 3, device_, [this](int) { return config_.feature_rate; }};
  ShRestGroup f_rest_{device_, [this](int) { return config_.feature_rate / 20.0; }};
  TrainedGroup opacity_{"opacity", 1, device_, [this](int) { return config_.opacity_rate; }, Activation::sigmoid};
  TrainedGroup scaling_{"scaling", 3, device_, [this](int) { return config_.scaling_rate; }, Activation::exponential};
  TrainedGroup rotation_{"rotation", 4, device_, [this](int) { return config_.rotation_rate; }};
  std::vector<TrainedGroup*> own_groups_;  ///< the groups above
  std::vector<TrainedGroup*> groups_;      ///< own_groups_ and the method's
  std::vector<TrainedGroup*> row_groups_;  ///< those of groups_ with one row per Gaussian

  bool stale_ = true;        ///< parameters changed since activate()
  bool set_changed_ = true;  ///< Gaussians added or removed since activate(), or the method requested a renewal

  /// Rendered images, or gradients with respect to them.
  struct ImageSet {
    explicit ImageSet(Device device) : color(device), features(device), inverse_depth(device), alpha(device) {}
    /// Allocates the images that the loss reads.
    RasterImages of(const Camera& camera, const Gaussians& gaussians, const LossInputs& inputs, bool with_color = true);
    void clear(bool color_too);
    Array<float> color, features, inverse_depth, alpha;
  };
  struct SecondView {
    explicit SecondView(Device device) : rasterizer(device), images(device), gradients(device), truth(device) {}
    Rasterizer rasterizer;  ///< separate, because backward() needs the state of its own forward()
    ImageSet images, gradients;
    Array<std::uint8_t> truth;  ///< on a GPU: a copy of colour, then mask
  };
  ImageSet images_{device_}, gradients_{device_};
  std::unique_ptr<SecondView> second_;  ///< created in the first step with a second view
  TrainingTruths truths_{context_.scene, device_};
  Array<float> screen_{device_}, screen_abs_{device_};                  ///< [N,2] gradients of this iteration
  Array<float> gradient_sum_{device_}, gradient_abs_sum_{device_};      ///< [N] norms since the last growth, NDC
  Array<float> seen_{device_};                                          ///< [N] number of views in these sums
  Array<float> mean_gradients_{device_}, mean_gradients_abs_{device_};  ///< [N]
  Array<float> max_scales_{device_};                                    ///< [N]
  Array<float> camera_centres_{device_}, camera_distances_{device_};    ///< [C,3], [C]; empty: not known yet
  Array<float> clearances_{device_};                                    ///< [N]
  Array<float> workspace_{device_};                                     ///< for select()

  // For density control, which runs on the host.
  struct OnHost {
    std::vector<float> mean_gradients, mean_gradients_abs, opacities, max_scales, clearances;
  };
  OnHost on_host_;                      ///< copies of statistics in device memory
  std::vector<std::uint32_t> origins_;  ///< [N] index before the growth of this iteration
};

}  // namespace splatboost
