// SPDX-License-Identifier: Apache-2.0
#include "families/gaussians/gaussian_backbone.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include <glm/gtc/quaternion.hpp>

#include "splatboost/activations.h"
#include "splatboost/array.h"
#include "splatboost/density_statistics.h"
#include "splatboost/elementwise.h"
#include "splatboost/neighbors.h"
#include "splatboost/random.h"
#include "splatboost/rasterizer.h"
#include "splatboost/rows.h"
#include "splatboost/select.h"
#include "splatboost/spatial_order.h"
#include "trainer/backbone_api/training_truths.h"
#include "trainer/dataset/splat_ply.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr float kShDc = 0.28209479177387814f;  // degree-0 basis value
constexpr float kMinSquaredDistance = 1e-7f;   // of neighbours at initialisation, keeps log-scales finite
constexpr int kRestRows = 15;
constexpr int kSplitChildren = 2;
constexpr float kSplitShrink = 0.8f * kSplitChildren;
constexpr int kLeastGrowthsAReset = 5;
constexpr const char* kGroupsFile = "parameters.bin";  ///< of a model: the method's groups

float logit(double p) { return static_cast<float>(std::log(p / (1 - p))); }

/// Rows of new Gaussians.
struct NewRows {
  std::vector<std::uint32_t> points;  ///< that they are made of
  std::vector<float> means, dc, log_scales, rotations;
};

void append_rows(TrainedGroup& group, std::span<const float> rows) {
  const std::size_t first = group.values.size();
  for (Array<float>* tensor : {&group.values, &group.gradients, &group.first_moments, &group.second_moments}) {
    append_zero_rows(*tensor, group.width, rows.size() / group.width);
  }
  group.values.edit(first, [&](std::span<float> values) { std::ranges::copy(rows, values.begin()); });
}

class GaussianBackbone final : public Backbone, private RasterizerHook, private ViewDrawer, private GaussianSet {
 public:
  GaussianBackbone(const BackboneContext& context, const GaussianConfig& config, std::unique_ptr<GaussianMethod> method)
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
    step_all(iteration_);
    wait();
  }
  std::size_t primitives() const override { return opacity_.rows(); }
  std::size_t bytes_per_primitive() const override;
  void render(const Camera& camera, float time, std::optional<float> beta, std::span<float> color) override;
  bool uses_time() const override { return method_->uses_time(); }
  void export_moment(float time, const std::filesystem::path& file) override;
  bool has_surfaces() const override { return true; }
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

  // ViewDrawer
  std::size_t views() const override { return context_.scene.train.size(); }
  Rasterizer& draw(std::size_t view) override;

  // GaussianSet
  std::size_t size() const override { return opacity_.rows(); }
  std::vector<float> means() const override { return xyz_.values.to_host(); }
  std::vector<std::uint32_t> insert(const PointCloud& points) override;
  void transform(std::span<const std::int32_t> which, std::span<const Similarity> transforms) override;

  void initialise();
  /// Of at most `most` points, evenly chosen.
  NewRows rows_of(const PointCloud& points, std::size_t most) const;
  void activate();
  Gaussians activated() const;
  /// What the rasterizer gets.
  Gaussians drawn(const DrawContext& context);
  Gaussians drawn_second(const DrawContext& context, const LossInputs& inputs);
  RasterOptions raster_options(std::optional<float> beta) const;
  int at(int published) const { return scaled_iteration(published, total(), config_.published_iterations); }
  /// Of the run, as far as it is known.
  int total() const { return method_->planned_iterations(iteration_, context_.iterations); }
  /// Scaled as all phases are, but in a short run opacities need time to come back.
  int opacity_reset_interval() const {
    return std::max(at(config_.opacity_reset_interval), kLeastGrowthsAReset * config_.densify_interval);
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
  /// What the rasterizer timed itself; on a GPU, where asking would wait, `all` of it as one stage.
  template <class... Stages>
  void lap_rasterizer(const char* all, const Stages&... stages);
  /// The method's that models hold.
  std::vector<TrainedGroup*> model_groups() const {
    std::vector<TrainedGroup*> kept;
    for (std::size_t i = own_groups_.size(); i < groups_.size(); ++i) {
      if (groups_[i]->in_model) kept.push_back(groups_[i]);
    }
    return kept;
  }
  std::string entry(const char* what) const { return std::string(method_->name()) + "." + what; }

  StepView draw_second(const View& view, int iteration, const LossInputs& inputs);
  /// @return the loss; leaves its gradients in those of the views
  double evaluate_loss(std::span<const StepView> views);
  /// Adds a view's gradients to those of the parameters. @param gradients where those of density control go
  void backward(Rasterizer& rasterizer, const Gaussians& gaussians, const RasterImages& image_gradients,
                GaussianGradients gradients);
  void step_group(TrainedGroup& group, int iteration);
  void step_all(int iteration);
  void step_scheduled(int iteration);

  void control_density();
  DensityStatistics statistics();
  void grow();
  void hold_cap(std::span<const float> gradients, std::vector<std::uint8_t>& clone,
                std::vector<std::uint8_t>& split) const;
  void prune(PruneRule rule);
  void append_children(std::span<const std::uint32_t> parents);
  /// A point of each one's own distribution, relative to its mean. @param scales [n,3] @param rotations [n,4]
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

  // Names of the groups are 3DGS's.
  TrainedGroup xyz_{"xyz", 3, device_, [this](int iteration) { return position_rate(iteration); }};
  TrainedGroup f_dc_{"f_dc", 3, device_, [this](int) { return config_.feature_rate; }};
  TrainedGroup f_rest_{"f_rest", 3 * kRestRows, device_, [this](int) { return config_.feature_rate / 20.0; }};
  TrainedGroup opacity_{"opacity", 1, device_, [this](int) { return config_.opacity_rate; }, Activation::sigmoid};
  TrainedGroup scaling_{"scaling", 3, device_, [this](int) { return config_.scaling_rate; }, Activation::exponential};
  TrainedGroup rotation_{"rotation", 4, device_, [this](int) { return config_.rotation_rate; }};
  std::vector<TrainedGroup*> own_groups_;  ///< these
  std::vector<TrainedGroup*> groups_;      ///< and the method's
  std::vector<TrainedGroup*> row_groups_;  ///< of all

  bool stale_ = true;        ///< parameters moved since activate()
  bool set_changed_ = true;  ///< Gaussians came or went since activate(), or what the method keeps of them is due

  /// Images of the rasterizer's shapes, or gradients with respect to them.
  struct ImageSet {
    explicit ImageSet(Device device) : color(device), features(device), inverse_depth(device), alpha(device) {}
    /// Makes room for those that the loss reads.
    RasterImages of(const Camera& camera, const Gaussians& gaussians, const LossInputs& inputs);
    void clear(bool color_too);
    Array<float> color, features, inverse_depth, alpha;
  };
  struct SecondView {
    explicit SecondView(Device device) : rasterizer(device), images(device), gradients(device), truth(device) {}
    Rasterizer rasterizer;  ///< of its own, because a backward pass needs the forward pass before it
    ImageSet images, gradients;
    Array<std::uint8_t> truth;  ///< of a GPU: a copy
  };
  ImageSet images_{device_}, gradients_{device_};
  std::unique_ptr<SecondView> second_;  ///< from the first step on that has one
  TrainingTruths truths_{context_.scene, device_};
  Array<float> screen_{device_}, screen_abs_{device_};                  ///< [N,2] gradients of this iteration
  Array<float> gradient_sum_{device_}, gradient_abs_sum_{device_};      ///< [N] norms since the last growth, NDC
  Array<float> seen_{device_};                                          ///< [N] views that they come from
  Array<float> mean_gradients_{device_}, mean_gradients_abs_{device_};  ///< [N]
  Array<float> max_scales_{device_};                                    ///< [N]
  Array<float> workspace_{device_};                                     ///< of select()

  // Of density control, which is decided on the host.
  struct OnHost {
    std::vector<float> mean_gradients, mean_gradients_abs, opacities, max_scales;
  };
  OnHost on_host_;                      ///< copies of a GPU's statistics
  std::vector<std::uint32_t> origins_;  ///< [N] index before the growth of this iteration
};

void GaussianBackbone::initialise() {
  own_groups_ = {&xyz_, &f_dc_, &f_rest_, &opacity_, &scaling_, &rotation_};
  groups_ = own_groups_;
  for (TrainedGroup* group : method_->groups()) groups_.push_back(group);
  std::set<std::string_view> names;
  for (TrainedGroup* group : groups_) {
    SPLATBOOST_CHECK(names.insert(group->name).second, "two groups of parameters are called " + group->name);
    if (group->shape == GroupShape::rows) row_groups_.push_back(group);
  }
  const PointCloud& points = context_.scene.points;
  const std::size_t most = context_.max_primitives > 0 ? context_.max_primitives : points.size();
  NewRows rows = rows_of(points, most);
  const std::size_t n = rows.points.size();
  xyz_.assign(std::move(rows.means));
  f_dc_.assign(std::move(rows.dc));
  f_rest_.assign(std::vector<float>(n * 3 * kRestRows, 0.0f));
  opacity_.assign(std::vector<float>(n, logit(config_.initial_opacity)));
  scaling_.assign(std::move(rows.log_scales));
  rotation_.assign(std::move(rows.rotations));
  method_->start(xyz_.values);
  reorder();
  restart_statistics();
  activate();
}

NewRows GaussianBackbone::rows_of(const PointCloud& points, std::size_t most) const {
  NewRows rows;
  const std::size_t n = std::min(points.size(), most);
  rows.points.reserve(n);
  rows.means.reserve(3 * n);
  rows.dc.reserve(3 * n);
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t from = i * points.size() / n;
    rows.points.push_back(static_cast<std::uint32_t>(from));
    for (std::size_t c = 0; c < 3; ++c) {
      rows.means.push_back(points.positions[3 * from + c]);
      rows.dc.push_back((static_cast<float>(points.colors[3 * from + c]) / 255.0f - 0.5f) / kShDc);
    }
  }
  std::vector<float> squared(n);
  mean_squared_neighbor_distances(rows.means, 3, squared, context_.threads);
  for (const float d : squared) {
    rows.log_scales.insert(rows.log_scales.end(), 3, 0.5f * std::log(std::max(d, kMinSquaredDistance)));
    rows.rotations.insert(rows.rotations.end(), {1, 0, 0, 0});
  }
  return rows;
}

std::vector<std::uint32_t> GaussianBackbone::insert(const PointCloud& points) {
  const std::size_t before = primitives();
  std::size_t most = points.size();
  if (context_.max_primitives > 0) most = context_.max_primitives - std::min(context_.max_primitives, before);
  NewRows rows = rows_of(points, most);
  const std::size_t n = rows.points.size();
  if (n == 0) return {};
  // All or none: where memory is short the model stays whole.
  for (TrainedGroup* group : row_groups_) group->reserve_rows(before + n);
  append_rows(xyz_, rows.means);
  append_rows(f_dc_, rows.dc);
  append_rows(opacity_, std::vector<float>(n, logit(config_.initial_opacity)));
  append_rows(scaling_, rows.log_scales);
  append_rows(rotation_, rows.rotations);
  for (TrainedGroup* group : row_groups_) {
    if (group->rows() == before) append_rows(*group, std::vector<float>(n * group->width, 0.0f));
  }
  for (Array<float>* sums : {&gradient_sum_, &gradient_abs_sum_, &seen_}) append_zero_rows(*sums, 1, n);
  stale_ = set_changed_ = true;
  return std::move(rows.points);
}

void GaussianBackbone::transform(std::span<const std::int32_t> which, std::span<const Similarity> transforms) {
  SPLATBOOST_CHECK(which.size() == primitives(), "there must be a transform, or -1, for each Gaussian");
  step_all(iteration_);
  const auto for_each_moved = [&](std::span<float> values, std::size_t width, const auto& move) {
    for (std::size_t i = 0; i < which.size(); ++i) {
      if (which[i] >= 0) move(&values[width * i], transforms[static_cast<std::size_t>(which[i])]);
    }
  };
  xyz_.values.edit(0, [&](std::span<float> values) {
    for_each_moved(values, 3, [](float* mean, const Similarity& by) {
      const glm::dvec3 moved = by.scale * (by.rotation * glm::dvec3(mean[0], mean[1], mean[2])) + by.translation;
      for (int c = 0; c < 3; ++c) mean[c] = static_cast<float>(moved[c]);
    });
  });
  rotation_.values.edit(0, [&](std::span<float> values) {
    for_each_moved(values, 4, [](float* q, const Similarity& by) {
      const glm::dquat turned = glm::quat_cast(by.rotation) * glm::dquat(q[0], q[1], q[2], q[3]);
      const double wxyz[4] = {turned.w, turned.x, turned.y, turned.z};
      for (int c = 0; c < 4; ++c) q[c] = static_cast<float>(wxyz[c]);
    });
  });
  scaling_.values.edit(0, [&](std::span<float> values) {
    for_each_moved(values, 3, [](float* logarithms, const Similarity& by) {
      for (int c = 0; c < 3; ++c) logarithms[c] += static_cast<float>(std::log(by.scale));
    });
  });
  xyz_.forget_moments();
  rotation_.forget_moments();
  restart_statistics();
  stale_ = set_changed_ = true;
}

std::size_t GaussianBackbone::bytes_per_primitive() const {
  std::size_t bytes = gaussian_memory_bytes();
  for (const TrainedGroup* group : row_groups_) {
    const bool known = std::ranges::find(own_groups_, group) != own_groups_.end();
    if (!known) bytes += 4 * sizeof(float) * group->width;  // with gradients and moments
  }
  return bytes + method_->bytes_per_gaussian();
}

void GaussianBackbone::restart_statistics() {
  const std::size_t n = primitives();
  gradient_sum_.assign_zeros(n);
  gradient_abs_sum_.assign_zeros(n);
  seen_.assign_zeros(n);
  method_->restart_statistics(n);
}

void GaussianBackbone::activate() {
  if (!stale_ && !set_changed_) return;
  for (TrainedGroup* group : groups_) {
    if (group->activation == Activation::none) continue;
    group->activated.ensure(group->values.size());
    const auto activate_values = group->activation == Activation::exponential ? exponentials : sigmoids;
    activate_values(group->values, group->activated, device_);
  }
  if (set_changed_) method_->gaussians_changed(xyz_.values);
  method_->activated(scaling_.activated, opacity_.activated);
  stale_ = set_changed_ = false;
}

Gaussians GaussianBackbone::activated() const {
  Gaussians g;
  g.count = primitives();
  g.means = xyz_.values;
  g.scales = scaling_.activated;
  g.rotations = rotation_.values;
  g.opacities = opacity_.activated;
  g.sh_dc = f_dc_.values;
  g.sh_rest = f_rest_.values;
  g.sh_rest_rows = kRestRows;
  g.sh_degree = sh_degree(iteration_);
  return g;
}

Gaussians GaussianBackbone::drawn(const DrawContext& context) {
  activate();
  Gaussians gaussians = activated();
  method_->draw(gaussians, context);
  return gaussians;
}

Gaussians GaussianBackbone::drawn_second(const DrawContext& context, const LossInputs& inputs) {
  Gaussians gaussians = drawn(context);
  if (!inputs.second_color) gaussians.sh_degree = 0;  // nobody looks
  return gaussians;
}

RasterOptions GaussianBackbone::raster_options(std::optional<float> beta) const {
  RasterOptions options = method_->raster_options();
  if (beta) {
    options.box = BoxPolicy::ellipse;
    options.beta = *beta;
  }
  options.background = glm::vec3(context_.scene.white_background ? 1.0f : 0.0f);
  return options;
}

template <class... Stages>
void GaussianBackbone::lap_rasterizer(const char* all, const Stages&... stages) {
  if (device_.is_cuda()) return clock_.lap(all);
  const RasterSeconds& seconds = rasterizer_.seconds();
  (clock_.add(stages.first, seconds.*stages.second), ...);
}

RasterImages GaussianBackbone::ImageSet::of(const Camera& camera, const Gaussians& gaussians,
                                            const LossInputs& inputs) {
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  color.ensure(3 * pixels);
  features.ensure(inputs.features ? static_cast<std::size_t>(gaussians.features_per_gaussian) * pixels : 0);
  inverse_depth.ensure(inputs.inverse_depth ? pixels : 0);
  alpha.ensure(inputs.alpha ? pixels : 0);
  return {color, features, inverse_depth, alpha};
}

void GaussianBackbone::ImageSet::clear(bool color_too) {
  if (color_too) color.assign_zeros(color.size());
  for (Array<float>* channel : {&features, &inverse_depth, &alpha}) channel->assign_zeros(channel->size());
}

StepView GaussianBackbone::draw_second(const View& view, int iteration, const LossInputs& inputs) {
  if (!second_) second_ = std::make_unique<SecondView>(device_);
  SecondView& second = *second_;
  // A camera of the method's own has no photo.
  StepView step{{view.camera, view.time, iteration, DrawPurpose::train, &view},
                view.color.empty() ? TruthImage{} : truths_.of(view),
                {},
                {},
                {}};
  if (device_.is_cuda()) {
    // The truth of the first view may take the place of this one.
    const std::size_t color = step.truth.color.size(), valid = step.truth.valid.size();
    second.truth.ensure(color + valid);
    std::uint8_t* at = second.truth.cuda().data();
    if (color > 0) device_.stream().copy_on_device(at, step.truth.color.data(), color);
    if (valid > 0) device_.stream().copy_on_device(at + color, step.truth.valid.data(), valid);
    step.truth.color = {at, color};
    step.truth.valid = {at + color, valid};
  }
  const Gaussians gaussians = drawn_second(step.context, inputs);
  step.images = second.images.of(view.camera, gaussians, inputs);
  step.gradients = second.gradients.of(view.camera, gaussians, inputs);
  second.gradients.clear(true);
  second.rasterizer.forward(view.camera, gaussians, raster_options(beta_), step.images);
  step.visible = second.rasterizer.visible();
  return step;
}

double GaussianBackbone::evaluate_loss(std::span<const StepView> views) {
  const LossForm form = method_->loss();
  const StepView& first = views.front();
  gradients_.clear(form.scale == 0);
  double loss = 0;
  if (form.scale != 0) {
    if (form.clamped) clamp_above(images_.color, 1, device_);
    // The run ends with the loss of its end.
    const bool ahead = first.context.iteration != total();
    const PhotometricLoss measured =
        ahead ? photometric_.evaluate_ahead(images_.color, first.truth, form.lambda_dssim, gradients_.color)
              : photometric_.evaluate(images_.color, first.truth, form.lambda_dssim, gradients_.color);
    loss = form.scale * measured.total;
    if (form.clamped) clear_from(images_.color, 1, gradients_.color, device_);
    if (form.scale != 1) scale(gradients_.color, form.scale, device_);
  }
  return loss + method_->add_loss(views);
}

void GaussianBackbone::backward(Rasterizer& rasterizer, const Gaussians& gaussians, const RasterImages& image_gradients,
                                GaussianGradients gradients) {
  gradients.mode = GradientMode::accumulate;
  gradients.means = xyz_.gradients;
  gradients.scales = scaling_.gradients;
  gradients.rotations = rotation_.gradients;
  gradients.opacities = opacity_.gradients;
  if (!image_gradients.color.empty()) {
    gradients.sh_dc = f_dc_.gradients;
    gradients.sh_rest = f_rest_.gradients;
  }
  const GaussianGradients of_activated = gradients;
  method_->redirect(gradients);
  rasterizer.backward(
      gaussians,
      {image_gradients.color, image_gradients.features, image_gradients.inverse_depth, image_gradients.alpha},
      gradients);
  const bool of_first = &rasterizer == &rasterizer_;
  if (of_first) {
    lap_rasterizer("render_backward", std::pair("blend_backward", &RasterSeconds::blend_backward),
                   std::pair("project_backward", &RasterSeconds::project_backward));
  }
  method_->add_gradients(of_activated);
  if (const char* const stage = method_->stages().add_gradients; of_first && stage != nullptr) clock_.lap(stage);
}

double GaussianBackbone::train_step(int iteration, const View& view) {
  clock_.restart();
  iteration_ = iteration;
  method_->edit(*this, iteration);
  const std::size_t n = primitives();
  const DrawContext context{view.camera, view.time, iteration, DrawPurpose::train, &view};
  const LossInputs inputs = method_->loss_inputs(context);
  const bool two_views = inputs.second != nullptr;
  const StepView none{context, {}, {}, {}, {}};
  StepView views[2] = {none, two_views ? draw_second(*inputs.second, iteration, inputs) : none};
  if (two_views) clock_.lap("second_view");
  StepView& first = views[0];
  const MethodStages stages = method_->stages();
  if (stages.draw != nullptr) {
    activate();
    clock_.lap("activate");
  }
  const Gaussians gaussians = drawn(context);
  if (stages.draw != nullptr) clock_.lap(stages.draw);
  first.images = images_.of(view.camera, gaussians, inputs);
  first.gradients = gradients_.of(view.camera, gaussians, inputs);
  if (stages.draw == nullptr) clock_.lap("activate");
  rasterizer_.forward(view.camera, gaussians, raster_options(beta_), first.images);
  lap_rasterizer("render", std::pair("project", &RasterSeconds::project),
                 std::pair("tile_lists", &RasterSeconds::tile_lists), std::pair("blend", &RasterSeconds::blend));

  first.truth = truths_.of(view);
  first.visible = rasterizer_.visible();
  const double loss = evaluate_loss({views, two_views ? 2u : 1u});
  clock_.lap("loss");

  GaussianGradients statistics;
  const bool growing = iteration < at(config_.densify_until);
  if (growing) {
    screen_.ensure(2 * n);
    statistics.screen_means = screen_;
    if (needs_absolute_gradients()) {
      screen_abs_.ensure(2 * n);
      statistics.screen_means_abs = screen_abs_;
    }
  }
  backward(rasterizer_, gaussians, first.gradients, statistics);
  for (TrainedGroup* group : own_groups_) group->pending = true;
  if (growing) {
    add_screen_gradients({rasterizer_.visible(), statistics.screen_means, statistics.screen_means_abs,
                          view.camera.width, view.camera.height},
                         method_->absolute_norm(), method_->views_seen(beta_.has_value()), gradient_sums(), device_);
    method_->gather(rasterizer_);
  }
  clock_.lap("statistics");
  if (two_views) {
    if (!inputs.second_color) views[1].gradients.color = {};
    backward(second_->rasterizer, drawn_second(views[1].context, inputs), views[1].gradients, {});
    clock_.lap("second_view");
  }
  step_scheduled(iteration);
  clock_.lap("optimizer");
  control_density();
  // Now rather than before the next view, so that a checkpoint holds it.
  if (method_->renews_at(moment())) set_changed_ = true;
  if (set_changed_) activate();
  clock_.lap("density");
  return loss;
}

void GaussianBackbone::step_group(TrainedGroup& group, int iteration) {
  if (!group.pending) return;
  // The rasterizer's gradients are of activated values; these have not changed since the last step of the group.
  if (group.activation == Activation::exponential) exponential_gradients(group.activated, group.gradients, device_);
  if (group.activation == Activation::sigmoid) sigmoid_gradients(group.activated, group.gradients, device_);
  AdamOptions options;
  options.learning_rate = static_cast<float>(group.rate(iteration));
  if (optimizer_ != nullptr) options.learning_rate *= optimizer_->rate_factor(group.name, moment());
  group.step(options, device_);
  stale_ = true;
}

void GaussianBackbone::step_all(int iteration) {
  for (TrainedGroup* group : groups_) step_group(*group, iteration);
  activate();
}

void GaussianBackbone::step_scheduled(int iteration) {
  for (TrainedGroup* group : groups_) {
    if (optimizer_ == nullptr || optimizer_->steps_at(group->name, moment())) step_group(*group, iteration);
  }
}

DensityStatistics GaussianBackbone::statistics() {
  activate();
  const std::size_t n = primitives();
  mean_gradients_.ensure(n);
  mean_gradients_abs_.ensure(n);
  max_scales_.ensure(n);
  mean_screen_gradients(gradient_sums(), mean_gradients_, mean_gradients_abs_, device_);
  longest_scales(scaling_.activated, max_scales_, device_);
  return {moment(),
          context_.scene.extent,
          mean_gradients_.on_host(on_host_.mean_gradients),
          mean_gradients_abs_.on_host(on_host_.mean_gradients_abs),
          opacity_.activated.on_host(on_host_.opacities),
          max_scales_.on_host(on_host_.max_scales)};
}

void GaussianBackbone::control_density() {
  const int until = at(config_.densify_until);
  const bool own =
      iteration_ < until && iteration_ > at(config_.densify_from) && iteration_ % config_.densify_interval == 0;
  // No statistics are gathered after the end of growth, whatever a hook says.
  if (density_ != nullptr ? iteration_ < until && density_->grows_at(moment(), own) : own) {
    step_all(iteration_);
    grow();
    prune(PruneRule::growth);
    reorder();
    restart_statistics();
  }
  if (method_->trims_at(moment())) {
    step_all(iteration_);
    prune(PruneRule::trim);
    restart_statistics();
  }
  // A method that grows to the end of the run may have just grown.
  if (density_ != nullptr && density_->prunes_at(moment(), false)) {
    step_all(iteration_);
    prune(PruneRule::late);
    restart_statistics();
  }
  const bool white_start =
      context_.scene.white_background && config_.densify_from > 0 && iteration_ == at(config_.densify_from);
  const bool own_reset = iteration_ < until && (iteration_ % opacity_reset_interval() == 0 || white_start);
  if (density_ != nullptr ? density_->resets_opacities_at(moment(), own_reset) : own_reset) {
    step_all(iteration_);
    reset_opacities();
  }
}

void GaussianBackbone::grow() {
  const DensityStatistics known = statistics();
  const std::size_t n = primitives();
  std::vector<std::uint8_t> growing(n), clone(n), split(n);
  const std::span<const float> gradients =
      method_->grows_by_absolute_gradients() ? known.gradients_abs : known.gradients;
  for (std::size_t i = 0; i < n; ++i) growing[i] = gradients[i] >= static_cast<float>(config_.gradient_threshold);
  method_->add_growing(known, growing);
  const auto border = static_cast<float>(config_.percent_dense * static_cast<double>(context_.scene.extent));
  for (std::size_t i = 0; i < n; ++i) {
    clone[i] = growing[i] != 0 && known.max_scales[i] <= border;
    split[i] = growing[i] != 0 && known.max_scales[i] > border;
  }
  if (density_ != nullptr) {
    GrowDecisions decisions{clone, split};
    density_->grow(known, *this, decisions);
  }
  hold_cap(gradients, clone, split);

  origins_.resize(n);
  std::iota(origins_.begin(), origins_.end(), 0u);
  std::vector<std::uint32_t> clones, parents;
  for (std::size_t i = 0; i < n; ++i) {
    if (split[i] != 0) {
      parents.push_back(static_cast<std::uint32_t>(i));
    } else if (clone[i] != 0) {
      clones.push_back(static_cast<std::uint32_t>(i));
    }
  }
  // All or none: where memory is short the model stays whole.
  for (TrainedGroup* group : row_groups_) group->reserve_rows(n + clones.size() + kSplitChildren * parents.size());
  const Array<std::uint32_t> listed(device_, clones);
  const std::size_t first_clone = primitives();
  for (TrainedGroup* group : row_groups_) group->append_copies(listed);
  origins_.insert(origins_.end(), clones.begin(), clones.end());
  if (method_->scatters_clones()) {
    Array<float> scales(device_), rotations(device_);
    append_rows_of(scaling_.activated, 3, listed, scales);
    append_rows_of(rotation_.values, 4, listed, rotations);
    const RandomStream random(context_.seed, static_cast<std::uint64_t>(iteration_), RandomPurpose::grow);
    const std::vector<float> offsets = scattered(scales.to_host(), rotations.to_host(), random, 0);
    xyz_.values.edit(3 * first_clone, [&](std::span<float> means) {
      for (std::size_t k = 0; k < means.size(); ++k) means[k] += offsets[k];
    });
    stale_ = set_changed_ = true;
  }
  append_children(parents);
  split.resize(primitives(), 0);  // parents go, clones and children stay
  remove(split);
}

void GaussianBackbone::hold_cap(std::span<const float> gradients, std::vector<std::uint8_t>& clone,
                                std::vector<std::uint8_t>& split) const {
  if (context_.max_primitives == 0) return;
  // Clones and splits alike add one each.
  const std::size_t room = context_.max_primitives - std::min(context_.max_primitives, primitives());
  std::vector<std::uint8_t> growing(clone.size());
  for (std::size_t i = 0; i < growing.size(); ++i) growing[i] = clone[i] != 0 || split[i] != 0;
  keep_largest(gradients, room, growing);
  for (std::size_t i = 0; i < growing.size(); ++i) {
    clone[i] = clone[i] != 0 && growing[i] != 0;
    split[i] = split[i] != 0 && growing[i] != 0;
  }
}

std::vector<float> GaussianBackbone::scattered(std::span<const float> scales, std::span<const float> rotations,
                                               const RandomStream& random, std::uint64_t first_number) {
  std::vector<float> offsets(scales.size());
  for (std::size_t j = 0; j < scales.size() / 3; ++j) {
    // R·(scale ⊙ normal)
    const float* q = &rotations[4 * j];
    const float length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    const float w = q[0] / length, x = q[1] / length, y = q[2] / length, z = q[3] / length;
    const float rotation[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                                  {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                                  {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
    float offset[3];
    for (std::size_t c = 0; c < 3; ++c) {
      const std::uint64_t number = 3 * (first_number + j) + c;
      offset[c] = static_cast<float>(random.normal(number)) * scales[3 * j + c];
    }
    for (std::size_t c = 0; c < 3; ++c) {
      offsets[3 * j + c] = rotation[c][0] * offset[0] + rotation[c][1] * offset[1] + rotation[c][2] * offset[2];
    }
  }
  return offsets;
}

void GaussianBackbone::append_children(std::span<const std::uint32_t> parents) {
  const RandomStream random(context_.seed, static_cast<std::uint64_t>(iteration_), RandomPurpose::split);
  const Array<std::uint32_t> listed(device_, std::vector<std::uint32_t>(parents.begin(), parents.end()));
  Array<float> listed_scales(device_), listed_rotations(device_);
  append_rows_of(scaling_.activated, 3, listed, listed_scales);
  append_rows_of(rotation_.values, 4, listed, listed_rotations);
  const std::vector<float> scales = listed_scales.to_host(), rotations = listed_rotations.to_host();
  for (int child = 0; child < kSplitChildren; ++child) {
    const std::size_t first = primitives();
    for (TrainedGroup* group : row_groups_) group->append_copies(listed);
    origins_.insert(origins_.end(), parents.begin(), parents.end());
    const std::vector<float> offsets =
        scattered(scales, rotations, random, parents.size() * static_cast<std::size_t>(child));
    xyz_.values.edit(3 * first, [&](std::span<float> means) {
      for (std::size_t k = 0; k < means.size(); ++k) means[k] += offsets[k];
    });
    scaling_.values.edit(3 * first, [&](std::span<float> logarithms) {
      for (std::size_t k = 0; k < logarithms.size(); ++k) logarithms[k] = std::log(scales[k] / kSplitShrink);
    });
  }
  stale_ = set_changed_ = true;
}

void GaussianBackbone::prune(PruneRule rule) {
  if (rule == PruneRule::growth) {
    restart_statistics();
  } else {
    origins_.clear();
  }
  const DensityStatistics known = statistics();
  const std::size_t n = primitives();
  std::vector<std::uint8_t> removed(n, 0);
  if (rule == PruneRule::growth) {
    // The released code also tests sizes on screen, but zeroes them in the growth just before: that test never holds.
    const bool large_go = config_.max_world_scale > 0 && iteration_ > opacity_reset_interval();
    const auto large = static_cast<float>(config_.max_world_scale * static_cast<double>(context_.scene.extent));
    for (std::size_t i = 0; i < n; ++i) {
      removed[i] =
          known.opacities[i] < static_cast<float>(config_.min_opacity) || (large_go && known.max_scales[i] > large);
    }
  } else if (rule == PruneRule::trim) {
    method_->trim(known, static_cast<ViewDrawer&>(*this), removed);
  }
  if (density_ != nullptr) {
    PruneDecisions decisions{removed, rule, origins_};
    density_->prune(known, *this, decisions);
    method_->spare(moment(), rule, removed);
  }
  if (spare_one(known.opacities, removed) > 0) remove(removed);
}

void GaussianBackbone::remove(std::span<const std::uint8_t> removed) {
  select({device_, kept_rows(removed)});
  if (origins_.size() == removed.size()) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < removed.size(); ++i) {
      if (removed[i] == 0) origins_[kept++] = origins_[i];
    }
    origins_.resize(kept);
  }
}

void GaussianBackbone::select(const Array<std::uint32_t>& rows) {
  // Room for the widest tensor first: where memory is short the model stays whole. The CPU needs none.
  std::size_t widest = 0;
  for (const TrainedGroup* group : row_groups_) widest = std::max(widest, group->width);
  if (device_.is_cuda()) workspace_.ensure(rows.size() * widest);
  for (TrainedGroup* group : row_groups_) group->select(rows, workspace_);
  stale_ = set_changed_ = true;
}

/// Growth appends; here neighbours in space become neighbours in memory again, which the rasterizer's caches thank.
void GaussianBackbone::reorder() {
  Array<std::uint32_t> order(device_);
  order.ensure(primitives());
  if (device_.is_cuda()) {
    spatial_order(xyz_.values, order, device_.stream());
  } else {
    spatial_order(xyz_.values, order);
  }
  select(order);
}

void GaussianBackbone::reset_opacities() {
  const std::vector<float> factors = copy_to_host(method_->opacity_factors(), device_);
  const float cap = logit(config_.reset_opacity);
  opacity_.values.edit(0, [&](std::span<float> values) {
    for (std::size_t i = 0; i < values.size(); ++i) {
      float& value = values[i];
      if (factors.empty()) {
        value = std::min(value, cap);
      } else if (config_.reset_opacity < static_cast<double>(factors[i])) {
        // The reset speaks of what is drawn; where the factor alone keeps that below, nothing is left to do.
        value = std::min(value, logit(config_.reset_opacity / static_cast<double>(factors[i])));
      }
    }
  });
  opacity_.forget_moments();
  stale_ = true;
}

ScoredView GaussianBackbone::render_for_score(std::size_t view) {
  const View& truth = context_.scene.train[view];
  images_.color.ensure(truth.color.size());
  RasterImages images;
  images.color = images_.color;
  rasterizer_.forward(truth.camera, drawn({truth.camera, truth.time, iteration_, DrawPurpose::score, &truth}),
                      raster_options(beta_), images);
  rasterizer_.settle();
  if (method_->loss().clamped) clamp_above(images_.color, 1, device_);
  method_->compensate(images_.color, truth);
  return {images_.color, truths_.of(truth)};
}

Rasterizer& GaussianBackbone::draw(std::size_t view) {
  const View& truth = context_.scene.train[view];
  images_.color.ensure(truth.color.size());
  RasterImages images;
  images.color = images_.color;
  rasterizer_.forward(truth.camera, drawn({truth.camera, truth.time, iteration_, DrawPurpose::score, &truth}),
                      raster_options(beta_), images);
  rasterizer_.settle();
  return rasterizer_;
}

void GaussianBackbone::render_surface(const Camera& camera, float time, std::optional<float> beta,
                                      const SurfaceImages& images) {
  const Gaussians gaussians = drawn({camera, time, iteration_, DrawPurpose::surface});
  LossInputs inputs;
  inputs.alpha = inputs.inverse_depth = true;
  inputs.features = gaussians.features_per_gaussian > 0;
  const RasterImages there = images_.of(camera, gaussians, inputs);
  rasterizer_.forward(camera, gaussians, raster_options(beta ? beta : beta_), there);
  rasterizer_.settle();
  const auto fetch = [&](std::span<const float> from, std::span<float> to) {
    std::ranges::copy(copy_to_host(from, device_), to.begin());
  };
  fetch(there.color, images.color);
  fetch(there.alpha, images.alpha);
  Array<float> depth(device_);
  depth.ensure(there.alpha.size());
  if (method_->surface_depth(there.features, camera, depth)) return fetch(depth, images.depth);
  fetch(there.inverse_depth, images.depth);
  for (std::size_t p = 0; p < images.depth.size(); ++p) {
    images.depth[p] = images.depth[p] > 0 ? images.alpha[p] / images.depth[p] : 0.0f;
  }
}

void GaussianBackbone::render(const Camera& camera, float time, std::optional<float> beta, std::span<float> color) {
  RasterImages images;
  if (device_.is_cuda()) images_.color.ensure(color.size());
  images.color = device_.is_cuda() ? images_.color.span() : color;
  rasterizer_.forward(camera, drawn({camera, time, iteration_, DrawPurpose::evaluate}),
                      raster_options(beta ? beta : beta_), images);
  rasterizer_.settle();
  if (device_.is_cuda()) images_.color.cuda().download(color);
}

void GaussianBackbone::export_moment(float time, const std::filesystem::path& file) {
  if (!uses_time()) return Backbone::export_moment(time, file);
  const Gaussians moment = drawn({context_.scene.train.front().camera, time, iteration_, DrawPurpose::evaluate});
  SplatCloud cloud;
  cloud.means = copy_to_host(moment.means, device_);
  cloud.sh_dc = f_dc_.values.to_host();
  cloud.sh_rest = f_rest_.values.to_host();
  cloud.sh_rest_rows = kRestRows;
  for (const float opacity : copy_to_host(moment.opacities, device_)) {
    // Opacities of 0 and 1 have no logit.
    cloud.logit_opacities.push_back(logit(std::clamp(static_cast<double>(opacity), 1e-6, 1 - 1e-6)));
  }
  for (const float scale : copy_to_host(moment.scales, device_)) {
    // A Gaussian is the same with either sign of a scale, and a file holds its logarithm.
    cloud.log_scales.push_back(std::log(std::max(std::abs(scale), 1e-10f)));
  }
  cloud.rotations = copy_to_host(moment.rotations, device_);
  write_splat_ply(file, cloud);
}

std::uint64_t GaussianBackbone::export_model(const std::filesystem::path& folder) const {
  SplatCloud cloud;
  cloud.means = xyz_.values.to_host();
  cloud.sh_dc = f_dc_.values.to_host();
  cloud.sh_rest = f_rest_.values.to_host();
  cloud.sh_rest_rows = kRestRows;
  cloud.logit_opacities = opacity_.values.to_host();
  cloud.log_scales = scaling_.values.to_host();
  cloud.rotations = rotation_.values.to_host();
  method_->export_to(cloud);
  const std::filesystem::path path = folder / "point_cloud.ply";
  write_splat_ply(path, cloud);
  const std::vector<TrainedGroup*> kept = model_groups();
  if (kept.empty()) return std::filesystem::file_size(path);
  ArchiveWriter archive;
  std::vector<float> copy;
  for (const TrainedGroup* group : kept) archive.put(group->name, group->values.on_host(copy));
  archive.write(folder / kGroupsFile);
  return std::filesystem::file_size(path) + std::filesystem::file_size(folder / kGroupsFile);
}

void GaussianBackbone::import_model(const std::filesystem::path& folder) {
  SplatCloud cloud = read_splat_ply(folder / "point_cloud.ply");
  const std::size_t n = cloud.size();
  if (const std::vector<TrainedGroup*> kept = model_groups(); !kept.empty()) {
    const ArchiveReader archive(folder / kGroupsFile);
    for (TrainedGroup* group : kept) {
      std::vector<float> values = archive.floats(group->name);
      require(values.size() == (group->shape == GroupShape::rows ? n * group->width : group->values.size()),
              archive.path().string() + ": '" + group->name + "' does not fit to point_cloud.ply or to this backbone");
      group->assign(std::move(values));
    }
  }
  for (TrainedGroup* group : row_groups_) {
    if (!group->in_model) group->assign(std::vector<float>(n * group->width, 0.0f));
  }
  set_changed_ = !method_->import_from(cloud);
  std::vector<float> rest(n * 3 * kRestRows, 0.0f);
  const auto rows = static_cast<std::size_t>(cloud.sh_rest_rows);
  for (std::size_t i = 0; i < n; ++i) {
    std::copy_n(cloud.sh_rest.begin() + static_cast<std::ptrdiff_t>(3 * rows * i), 3 * rows,
                rest.begin() + static_cast<std::ptrdiff_t>(3 * kRestRows * i));
  }
  xyz_.assign(std::move(cloud.means));
  f_dc_.assign(std::move(cloud.sh_dc));
  f_rest_.assign(std::move(rest));
  opacity_.assign(std::move(cloud.logit_opacities));
  scaling_.assign(std::move(cloud.log_scales));
  rotation_.assign(std::move(cloud.rotations));
  restart_statistics();
  iteration_ = context_.iterations;  // a finished model: all degrees are active
  stale_ = true;
  activate();
}

void GaussianBackbone::save(ArchiveWriter& archive) const {
  archive.put(entry("iteration"), std::int64_t{iteration_});
  archive.put(entry("config"), std::string_view(method_->config().dump()));
  for (const TrainedGroup* group : groups_) group->save(archive);
  std::vector<float> copy;
  archive.put(entry("gradient_sum"), gradient_sum_.on_host(copy));
  archive.put(entry("gradient_abs_sum"), gradient_abs_sum_.on_host(copy));
  archive.put(entry("seen"), seen_.on_host(copy));
  method_->save(archive);
}

void GaussianBackbone::load(ArchiveReader& archive) {
  if (archive.text(entry("config")) != method_->config().dump()) {
    throw InputError(archive.path().string() +
                     ": the checkpoint was made with other backbone constants; continue with the same --config");
  }
  std::vector<std::size_t> dense_sizes;
  for (TrainedGroup* group : groups_) {
    if (group->shape == GroupShape::dense) dense_sizes.push_back(group->values.size());
    group->load(archive);
  }
  iteration_ = static_cast<int>(archive.integer(entry("iteration")));
  gradient_sum_.assign(archive.floats(entry("gradient_sum")));
  gradient_abs_sum_.assign(archive.floats(entry("gradient_abs_sum")));
  seen_.assign(archive.floats(entry("seen")));
  const std::size_t n = primitives();
  bool fits = gradient_sum_.size() == n && gradient_abs_sum_.size() == n && seen_.size() == n;
  for (const TrainedGroup* group : row_groups_) fits = fits && group->rows() == n;
  auto dense_size = dense_sizes.begin();
  for (const TrainedGroup* group : groups_) {
    if (group->shape == GroupShape::dense) fits = fits && group->values.size() == *dense_size++;
  }
  if (!fits) throw InputError(archive.path().string() + ": tensors do not fit together; the checkpoint is damaged");
  method_->load(archive, n);
  stale_ = true;
  set_changed_ = false;
}

}  // namespace

std::unique_ptr<Backbone> make_gaussian_backbone(const BackboneContext& context, const GaussianConfig& config,
                                                 std::unique_ptr<GaussianMethod> method) {
  return std::make_unique<GaussianBackbone>(context, config, std::move(method));
}

}  // namespace splatboost
