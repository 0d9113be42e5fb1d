// SPDX-License-Identifier: Apache-2.0
#include "convex_splatting/convex_splatting.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>
#include <utility>

#include "convex_splatting/convex_file.h"
#include "convex_splatting/convex_mesh.h"
#include "convex_splatting/convex_shapes.h"
#include "splatboost/array.h"
#include "splatboost/constants.h"
#include "splatboost/convex_rasterizer.h"
#include "splatboost/convex_training.h"
#include "splatboost/neighbors.h"
#include "splatboost/rows.h"
#include "splatboost/select.h"
#include "splatboost/spatial_order.h"
#include "trainer/backbone_api/backbone_entry.h"
#include "trainer/backbone_api/raster_laps.h"
#include "trainer/backbone_api/trained_group.h"
#include "trainer/backbone_api/training_truths.h"
#include "trainer/dataset/scene_depths.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr float kMinSquaredDistance = 1e-7f;  // between neighbours at initialisation; keeps logarithms finite
constexpr float kInitialMask = 1.0f;          // logit
constexpr int kRestRows = 15;
constexpr int kMinGrowthsAReset = 5;
/// Measured in runs of 5 000 iterations, a sixth of the published run; more was not.
constexpr double kMostHaste = 4;

float logit(double p) { return static_cast<float>(std::log(p / (1 - p))); }
float sigmoid(float x) { return 1 / (1 + std::exp(-x)); }

class ConvexSplatting final : public Backbone, private RasterizerHook {
 public:
  ConvexSplatting(const BackboneContext& context, const ConvexConfig& config)
      : context_(context), config_(config), device_(context.device), rasterizer_(device_), photometric_(device_) {
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
  void render(const Camera& camera, float time, std::optional<float> beta, std::span<float> color) override;
  std::uint64_t export_model(const std::filesystem::path& folder) const override;
  void import_model(const std::filesystem::path& folder) override;
  void save(ArchiveWriter& archive) const override;
  void load(ArchiveReader& archive) override;
  nlohmann::json config() const override { return to_json(config_); }
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

  void initialise();
  void activate();
  Convexes drawn();
  ConvexOptions raster_options(std::optional<float> beta, float pixel_size) const;
  /// Pixel size of a training view or its half-size view, relative to the reference image (see reference_focal).
  float pixel_size_of(const View& view) const;
  /// The same for any camera, relative to the nearest of focal_lengths_.
  float pixel_size_of(const Camera& camera) const;
  int at(int published) const { return scaled_iteration(published, context_.iterations); }
  /// Scaled like all phases, with a minimum: opacities need time to recover in short runs.
  int opacity_reset_interval() const {
    return std::max(at(config_.opacity_reset_interval), kMinGrowthsAReset * config_.densify_interval);
  }
  int sh_degree() const { return std::min(config_.sh_degree, iteration_ / at(config_.sh_interval)); }
  Moment moment() const { return {iteration_, context_.iterations}; }

  void step_all();

  void control_density();
  DensityStatistics statistics();
  void grow();
  void append_children(std::span<const std::uint32_t> parents);
  void prune(PruneRule rule);
  void remove(std::span<const std::uint8_t> removed);
  void select(const Array<std::uint32_t>& rows);
  void reset_opacities();
  void reorder();
  void restart_statistics();

  BackboneContext context_;
  ConvexConfig config_;
  double unit_ = config_.absolute_distances ? 1.0 : typical_depth(context_.scene) / kConvexDepth;  ///< world units
  /// How much shorter than the published run this one is: points move as far in fewer steps.
  double haste_ =
      config_.absolute_distances
          ? 1.0
          : std::clamp(static_cast<double>(kPublishedIterations) / std::max(1, context_.iterations), 1.0, kMostHaste);
  Device device_;
  ConvexRasterizer rasterizer_;
  Photometric photometric_;
  std::optional<float> beta_;
  DensityHook* density_ = nullptr;
  OptimizerHook* optimizer_ = nullptr;
  StageClock clock_{device_};
  int iteration_ = 0;
  double gradient_threshold_ = 0;     ///< for this scene's size, see ConvexConfig::large_scene
  std::vector<float> focal_lengths_;  ///< px, of the reference images, ascending

  // Group names are those of the release.
  TrainedGroup points_{"convex_points", kConvexWidth, device_, [this](int iteration) {
                         return unit_ * haste_ *
                                exponential_rate(config_.points_rate_initial, config_.points_rate_final, iteration,
                                                 context_.iterations);
                       }};
  TrainedGroup smoothness_{"delta", 1, device_, [this](int) { return config_.smoothness_rate; },
                           Activation::exponential};
  TrainedGroup sharpness_{"sigma", 1, device_, [this](int) { return config_.sharpness_rate; }, Activation::exponential};
  TrainedGroup opacity_{"opacity", 1, device_, [this](int) { return config_.opacity_rate; }, Activation::sigmoid};
  TrainedGroup mask_{"mask", 1, device_, [this](int) { return config_.mask_rate; }, Activation::sigmoid};
  TrainedGroup f_dc_{"f_dc", 3, device_, [this](int) { return config_.feature_rate; }};
  TrainedGroup f_rest_{"f_rest", 3 * kRestRows, device_, [this](int) { return config_.feature_rate / 20.0; }};
  std::vector<TrainedGroup*> groups_{&points_, &smoothness_, &sharpness_, &opacity_, &mask_, &f_dc_, &f_rest_};

  bool stale_ = true;                                       ///< parameters changed since activate()
  Array<float> drawn_opacities_{device_};                   ///< [N] 0 where masked
  Array<float> drawn_opacity_gradients_{device_};           ///< [N]
  Array<float> color_{device_}, color_gradients_{device_};  ///< [3,H,W]
  TrainingTruths truths_{context_.scene, device_};
  Array<float> view_gradients_{device_}, view_gradients_abs_{device_};  ///< [N] of this iteration
  Array<float> gradient_sum_{device_}, gradient_abs_sum_{device_};      ///< [N] since the last growth
  Array<float> seen_{device_};                                          ///< [N] number of views in these sums
  Array<float> workspace_{device_};                                     ///< for select()

  // For density control, which runs on the host.
  std::vector<float> mean_gradients_, mean_gradients_abs_, opacities_copy_, max_scales_;
  std::vector<std::uint32_t> origins_;  ///< [N] index before the growth of this iteration
  std::size_t old_ = 0;                 ///< number of convexes that precede those created by the last growth
};

void ConvexSplatting::initialise() {
  const std::vector<float>& known = context_.scene.points.positions;
  require(!known.empty(), "the scene has no points to place convexes at; add a point cloud to the dataset");
  // Without added points, which may be far away.
  float extent = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    float low = known[axis], high = low;
    for (std::size_t i = axis; i < known.size(); i += 3) {
      low = std::min(low, known[i]);
      high = std::max(high, known[i]);
    }
    extent = std::max(extent, high - low);
  }
  const bool large = config_.large_scene > 0 && static_cast<double>(extent) > unit_ * config_.large_scene;
  gradient_threshold_ = config_.gradient_threshold * (large ? config_.large_scene_factor : 1);

  // Keep an even subset of the points if there are more than the cap.
  const PointCloud points = starting_points(context_.scene);
  std::size_t n = points.size();
  if (context_.max_primitives > 0) n = std::min(n, context_.max_primitives);
  std::vector<float> centres, dc;
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t from = i * points.size() / n;
    for (std::size_t c = 0; c < 3; ++c) {
      centres.push_back(points.positions[3 * from + c]);
      dc.push_back((static_cast<float>(points.colors[3 * from + c]) / 255.0f - 0.5f) / kShConstant);
    }
  }

  for (const View& view : context_.scene.train) {
    focal_lengths_.push_back(config_.reference_focal > 0 ? static_cast<float>(config_.reference_focal)
                                                         : view.camera.fx);
  }
  std::ranges::sort(focal_lengths_);
  focal_lengths_.erase(std::unique(focal_lengths_.begin(), focal_lengths_.end()), focal_lengths_.end());
  if (focal_lengths_.empty()) focal_lengths_.push_back(1);

  std::vector<float> squared(n);
  mean_squared_neighbor_distances(centres, 3, squared, context_.threads);
  std::vector<float> radii, log_smoothness;
  for (const float d : squared) {
    const double distance = std::sqrt(static_cast<double>(std::max(d, kMinSquaredDistance)));
    radii.push_back(static_cast<float>(config_.initial_size * distance));
    log_smoothness.push_back(static_cast<float>(std::log(config_.initial_smoothness / distance)));
  }
  points_.assign(spheres(centres, radii));
  smoothness_.assign(std::move(log_smoothness));
  sharpness_.assign(std::vector<float>(n, static_cast<float>(std::log(config_.initial_sharpness / (unit_ * haste_)))));
  opacity_.assign(std::vector<float>(n, logit(config_.initial_opacity)));
  mask_.assign(std::vector<float>(n, kInitialMask));
  f_dc_.assign(std::move(dc));
  f_rest_.assign(std::vector<float>(n * 3 * kRestRows, 0.0f));
  reorder();
  restart_statistics();
  activate();
}

std::size_t ConvexSplatting::bytes_per_primitive() const {
  std::size_t bytes = 0;
  for (const TrainedGroup* group : groups_) bytes += 4 * sizeof(float) * group->width;  // with gradients and moments
  constexpr std::size_t kActivated = 4 + 2, kStatistics = 2 + 3 + 4;                    // floats
  constexpr std::size_t kScores = 2 * 8 + 8 + 4 + 4;                                    // as in memory_estimate.cpp
  constexpr std::size_t kRecord = 160 + 8 + 9;                                          // record, listing, small arrays
  constexpr std::size_t kEntries = 10, kEntry = 4 + 4 + 8 + 8 + 4 + 128;  // tiles per convex (estimate); bytes per pair
  const std::size_t averages = bytes / 4;                                 // at the end of a run; growth needs less
  return bytes + (kActivated + kStatistics) * sizeof(float) + kScores + kRecord + kEntries * kEntry + averages;
}

void ConvexSplatting::restart_statistics() {
  const std::size_t n = primitives();
  gradient_sum_.assign_zeros(n);
  gradient_abs_sum_.assign_zeros(n);
  seen_.assign_zeros(n);
}

void ConvexSplatting::activate() {
  if (!stale_) return;
  splatboost::activate(groups_, device_);
  drawn_opacities_.ensure(primitives());
  mask_opacities(opacity_.activated, mask_.activated, drawn_opacities_, device_);
  stale_ = false;
}

Convexes ConvexSplatting::drawn() {
  activate();
  Convexes convexes;
  convexes.count = primitives();
  convexes.points_per_convex = static_cast<int>(kConvexPoints);
  convexes.points = points_.values;
  convexes.smoothness = smoothness_.activated;
  convexes.sharpness = sharpness_.activated;
  convexes.opacities = drawn_opacities_;
  convexes.sh_dc = f_dc_.values;
  convexes.sh_rest = f_rest_.values;
  convexes.sh_rest_rows = kRestRows;
  convexes.sh_degree = sh_degree();
  return convexes;
}

float ConvexSplatting::pixel_size_of(const View& view) const {
  if (config_.reference_focal > 0) return pixel_size_of(view.camera);
  const std::optional<std::size_t> index = training_index(context_.scene, view);
  return index ? context_.scene.train[*index].camera.fx / view.camera.fx : 1.0f;
}

float ConvexSplatting::pixel_size_of(const Camera& camera) const {
  const auto distance = [&](float focal) { return std::abs(std::log(focal / camera.fx)); };
  const auto nearest = std::ranges::min_element(focal_lengths_, {}, distance);
  return *nearest / camera.fx;
}

ConvexOptions ConvexSplatting::raster_options(std::optional<float> beta, float pixel_size) const {
  ConvexOptions options;
  if (beta) {
    options.box = ConvexBox::compact;
    options.beta = *beta;
  }
  options.background = glm::vec3(context_.scene.white_background ? 1.0f : 0.0f);
  options.pixel_size = pixel_size;
  options.released_view_direction = config_.released_view_direction;
  return options;
}

/// @return the photometric loss; the loss of the masks, λ · mean, is not included, only its gradients are applied
double ConvexSplatting::train_step(int iteration, const View& view) {
  clock_.restart();
  iteration_ = iteration;
  const std::size_t n = primitives();
  const Convexes convexes = drawn();
  clock_.lap("activate");
  color_.ensure(view.color.size());
  rasterizer_.forward(view.camera, convexes, raster_options(beta_, pixel_size_of(view)), color_);
  lap_forward(rasterizer_, device_, clock_);

  color_gradients_.ensure(view.color.size());
  const auto lambda = static_cast<float>(config_.lambda_dssim);
  // In the last iteration wait for the loss, so that the run reports the final one.
  const bool ahead = iteration != context_.iterations;
  const TruthImage truth = truths_.of(view);
  const PhotometricLoss loss = ahead ? photometric_.evaluate_ahead(color_, truth, lambda, color_gradients_)
                                     : photometric_.evaluate(color_, truth, lambda, color_gradients_);
  clock_.lap("loss");

  ConvexGradients gradients;
  gradients.mode = GradientMode::accumulate;
  gradients.points = points_.gradients;
  gradients.smoothness = smoothness_.gradients;
  gradients.sharpness = sharpness_.gradients;
  gradients.sh_dc = f_dc_.gradients;
  gradients.sh_rest = f_rest_.gradients;
  drawn_opacity_gradients_.assign_zeros(n);
  gradients.opacities = drawn_opacity_gradients_;
  const bool growing = iteration < at(config_.densify_until);
  if (growing) {
    view_gradients_.ensure(n);
    gradients.view_sharpness = view_gradients_;
    if (density_ != nullptr && density_->needs_absolute_gradients()) {
      view_gradients_abs_.ensure(n);
      gradients.view_sharpness_abs = view_gradients_abs_;
    }
  }
  rasterizer_.backward(convexes, color_gradients_, {}, gradients);
  const auto mask_slope = static_cast<float>(config_.lambda_mask / static_cast<double>(std::max<std::size_t>(n, 1)));
  mask_opacities_backward(opacity_.activated, mask_.activated, drawn_opacity_gradients_, mask_slope, opacity_.gradients,
                          mask_.gradients, device_);
  for (TrainedGroup* group : groups_) group->pending = true;
  lap_backward(rasterizer_, device_, clock_);

  if (growing) {
    add_sharpness_gradients(rasterizer_.visible(), gradients.view_sharpness, gradients.view_sharpness_abs,
                            {gradient_sum_, gradient_abs_sum_, seen_}, device_);
  }
  clock_.lap("statistics");
  if (step_due_groups(groups_, optimizer_, moment(), device_)) stale_ = true;
  average_if_due(groups_, optimizer_, moment(), device_);
  clock_.lap("optimizer");
  control_density();
  clock_.lap("density");
  return loss.total;
}

void ConvexSplatting::step_all() {
  if (step_groups(groups_, optimizer_, moment(), device_)) stale_ = true;
  activate();
}

DensityStatistics ConvexSplatting::statistics() {
  activate();
  const std::size_t n = primitives();
  std::vector<float> sum_copy, abs_copy, seen_copy, points_copy;
  const std::span<const float> sums = gradient_sum_.on_host(sum_copy), sums_abs = gradient_abs_sum_.on_host(abs_copy);
  const std::span<const float> seen = seen_.on_host(seen_copy);
  mean_gradients_.resize(n);
  mean_gradients_abs_.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    mean_gradients_[i] = seen[i] > 0 ? sums[i] / seen[i] : 0.0f;
    mean_gradients_abs_[i] = seen[i] > 0 ? sums_abs[i] / seen[i] : 0.0f;
  }
  max_scales_.resize(n);
  longest_deviations(points_.values.on_host(points_copy), max_scales_);
  return {moment(),
          context_.scene.extent,
          mean_gradients_,
          mean_gradients_abs_,
          opacity_.activated.on_host(opacities_copy_),
          max_scales_};
}

void ConvexSplatting::control_density() {
  const int until = at(config_.densify_until);
  const bool own =
      iteration_ < until && iteration_ > at(config_.densify_from) && iteration_ % config_.densify_interval == 0;
  // After densify_until no statistics are gathered, so a hook cannot request growth.
  if (density_ != nullptr ? iteration_ < until && density_->grows_at(moment(), own) : own) {
    step_all();
    grow();
    prune(PruneRule::growth);
    reorder();
    restart_statistics();
  }
  // Not at the end of the run: the model that the release saves there is not pruned either.
  if (iteration_ >= until && iteration_ < context_.iterations && iteration_ % at(config_.trim_interval) == 0) {
    step_all();
    prune(PruneRule::trim);
    restart_statistics();
  }
  if (density_ != nullptr && density_->prunes_at(moment(), false)) {
    step_all();
    prune(PruneRule::late);
    restart_statistics();
  }
  const bool white_start = context_.scene.white_background && iteration_ == at(config_.densify_from);
  const bool own_reset = iteration_ < until && (iteration_ % opacity_reset_interval() == 0 || white_start);
  if (density_ != nullptr ? density_->resets_opacities_at(moment(), own_reset) : own_reset) {
    step_all();
    reset_opacities();
  }
  if (stale_) activate();
}

void ConvexSplatting::grow() {
  const DensityStatistics known = statistics();
  const std::size_t n = primitives();
  std::vector<std::uint8_t> clone(n, 0), split(n);
  for (std::size_t i = 0; i < n; ++i) split[i] = known.gradients[i] >= static_cast<float>(gradient_threshold_);
  if (density_ != nullptr) {
    GrowDecisions decisions{clone, split};
    density_->grow(known, *this, decisions);
  }
  if (context_.max_primitives > 0) {
    const std::size_t room = context_.max_primitives - std::min(context_.max_primitives, n);
    keep_largest(known.gradients, room / (kConvexPoints - 1), split);
  }
  std::vector<std::uint32_t> parents;
  for (std::size_t i = 0; i < n; ++i) {
    if (split[i] != 0) parents.push_back(static_cast<std::uint32_t>(i));
  }
  origins_.resize(n);
  std::iota(origins_.begin(), origins_.end(), 0u);
  // Reserve all groups first: if memory runs out, the model stays intact.
  forget_averages(groups_);
  for (TrainedGroup* group : groups_) group->reserve_rows(n + kConvexPoints * parents.size());
  append_children(parents);
  old_ = n - parents.size();
  split.resize(primitives(), 0);  // remove parents
  remove(split);
}

void ConvexSplatting::append_children(std::span<const std::uint32_t> parents) {
  const Array<std::uint32_t> listed(device_, std::vector<std::uint32_t>(parents.begin(), parents.end()));
  const std::size_t first = primitives();
  for (std::size_t child = 0; child < kConvexPoints; ++child) {
    for (TrainedGroup* group : groups_) group->append_copies(listed);
    origins_.insert(origins_.end(), parents.begin(), parents.end());
  }
  // The new rows are copies of the parents, one block per child index.
  points_.values.edit(kConvexWidth * first, [&](std::span<float> rows) {
    std::vector<float> parent(kConvexWidth);
    for (std::size_t k = 0; k < rows.size() / kConvexWidth; ++k) {
      const std::span<float> row = rows.subspan(kConvexWidth * k, kConvexWidth);
      std::ranges::copy(row, parent.begin());
      child_points(parent, k / parents.size(), static_cast<float>(config_.child_size), row);
    }
  });
  sharpness_.values.edit(first, [&](std::span<float> logarithms) {
    // The logarithm of the sharpness per unit of the settings.
    const auto factor = static_cast<float>(config_.child_log_sharpness), unit = static_cast<float>(std::log(unit_));
    for (float& value : logarithms) value = factor * (value + unit) - unit;
  });
  opacity_.values.edit(first, [&](std::span<float> logits) {
    for (float& value : logits) value = logit(config_.child_opacity * static_cast<double>(sigmoid(value)));
  });
  stale_ = true;
}

void ConvexSplatting::prune(PruneRule rule) {
  if (rule == PruneRule::growth) {
    restart_statistics();
  } else {
    origins_.clear();
  }
  const DensityStatistics known = statistics();
  const std::size_t n = primitives();
  std::vector<std::uint8_t> removed(n, 0);
  if (rule != PruneRule::late) {
    std::vector<float> copy;
    const std::span<const float> masks = mask_.activated.on_host(copy);
    // As released, sizes are tested only for convexes older than this growth, because new ones have no size yet there.
    bool large_go = false;
    if (rule == PruneRule::growth && config_.max_world_scale > 0) {
      large_go = iteration_ > opacity_reset_interval();
      if (density_ != nullptr) large_go = density_->prunes_large_at(moment(), large_go);
    }
    const auto large = static_cast<float>(config_.max_world_scale * static_cast<double>(context_.scene.extent));
    for (std::size_t i = 0; i < n; ++i) {
      removed[i] = known.opacities[i] < static_cast<float>(config_.min_opacity) ||
                   masks[i] <= static_cast<float>(config_.min_mask) ||
                   (large_go && i < old_ && known.max_scales[i] > large);
    }
  }
  if (density_ != nullptr) {
    PruneDecisions decisions{removed, rule, origins_};
    density_->prune(known, *this, decisions);
  }
  if (spare_one(known.opacities, removed) > 0) remove(removed);
}

void ConvexSplatting::remove(std::span<const std::uint8_t> removed) {
  select({device_, kept_rows(removed)});
  drop_removed(removed, origins_);
}

void ConvexSplatting::select(const Array<std::uint32_t>& rows) {
  select_rows(groups_, rows, workspace_, device_);
  stale_ = true;
}

/// Sorts convexes in spatial order, because growth appends new ones at the end; improves cache locality.
void ConvexSplatting::reorder() {
  std::vector<float> copy;
  std::vector<std::uint32_t> order(primitives());
  spatial_order(convex_centres(points_.values.on_host(copy)), order);
  select({device_, std::move(order)});
}

void ConvexSplatting::reset_opacities() {
  const float cap = logit(config_.reset_opacity);
  opacity_.values.edit(0, [&](std::span<float> values) {
    for (float& value : values) value = std::min(value, cap);
  });
  opacity_.forget_moments();
  forget_averages(groups_);
  stale_ = true;
}

ScoredView ConvexSplatting::render_for_score(std::size_t view) {
  const View& truth = context_.scene.train[view];
  color_.ensure(truth.color.size());
  rasterizer_.forward(truth.camera, drawn(), raster_options(beta_, pixel_size_of(truth)), color_);
  rasterizer_.settle();
  return {color_, truths_.of(truth)};
}

void ConvexSplatting::render(const Camera& camera, float, std::optional<float> beta, std::span<float> color) {
  if (device_.is_cuda()) color_.ensure(color.size());
  const std::span<float> image = device_.is_cuda() ? color_.span() : color;
  rasterizer_.forward(camera, drawn(), raster_options(beta ? beta : beta_, pixel_size_of(camera)), image);
  rasterizer_.settle();
  if (device_.is_cuda()) color_.cuda().download(color);
}

std::uint64_t ConvexSplatting::export_model(const std::filesystem::path& folder) const {
  ConvexCloud cloud;
  cloud.points = points_.values.to_host();
  cloud.log_smoothness = smoothness_.values.to_host();
  cloud.log_sharpness = sharpness_.values.to_host();
  cloud.logit_opacities = opacity_.values.to_host();
  cloud.logit_masks = mask_.values.to_host();
  cloud.sh_dc = f_dc_.values.to_host();
  cloud.sh_rest = f_rest_.values.to_host();
  cloud.focal_lengths = focal_lengths_;
  return write_convexes(folder, cloud);
}

void ConvexSplatting::import_model(const std::filesystem::path& folder) {
  ConvexCloud cloud = read_convexes(folder);
  points_.assign(std::move(cloud.points));
  smoothness_.assign(std::move(cloud.log_smoothness));
  sharpness_.assign(std::move(cloud.log_sharpness));
  opacity_.assign(std::move(cloud.logit_opacities));
  mask_.assign(std::move(cloud.logit_masks));
  f_dc_.assign(std::move(cloud.sh_dc));
  f_rest_.assign(std::move(cloud.sh_rest));
  focal_lengths_ = std::move(cloud.focal_lengths);
  restart_statistics();
  iteration_ = context_.iterations;  // a finished model: all SH degrees are active
  stale_ = true;
  activate();
}

void ConvexSplatting::save(ArchiveWriter& archive) const {
  archive.put("convex-splatting.iteration", std::int64_t{iteration_});
  archive.put("convex-splatting.config", std::string_view(to_json(config_).dump()));
  for (const TrainedGroup* group : groups_) group->save(archive);
  std::vector<float> copy;
  archive.put("convex-splatting.gradient_sum", gradient_sum_.on_host(copy));
  archive.put("convex-splatting.gradient_abs_sum", gradient_abs_sum_.on_host(copy));
  archive.put("convex-splatting.seen", seen_.on_host(copy));
}

void ConvexSplatting::load(ArchiveReader& archive) {
  if (archive.text("convex-splatting.config") != to_json(config_).dump()) {
    throw InputError(archive.path().string() +
                     ": the checkpoint was made with a different backbone config; continue with the same --config");
  }
  for (TrainedGroup* group : groups_) group->load(archive);
  iteration_ = static_cast<int>(archive.integer("convex-splatting.iteration"));
  gradient_sum_.assign(archive.floats("convex-splatting.gradient_sum"));
  gradient_abs_sum_.assign(archive.floats("convex-splatting.gradient_abs_sum"));
  seen_.assign(archive.floats("convex-splatting.seen"));
  const std::size_t n = primitives();
  bool fits = gradient_sum_.size() == n && gradient_abs_sum_.size() == n && seen_.size() == n;
  for (const TrainedGroup* group : groups_) fits = fits && group->rows() == n;
  if (!fits) throw InputError(archive.path().string() + ": tensor sizes do not match; the checkpoint is damaged");
  stale_ = true;
  activate();
}

}  // namespace

std::unique_ptr<Backbone> make_convex_splatting(const BackboneContext& context, const ConvexConfig& config) {
  return std::make_unique<ConvexSplatting>(context, config);
}

BackboneEntry convex_splatting_entry() {
  return {"convex-splatting", kPublishedIterations,
          [](const BackboneContext& context, const nlohmann::json& constants) {
            return make_convex_splatting(context, convex_config_from_json(constants));
          },
          [](const std::filesystem::path& model, const std::filesystem::path& file) {
            write_mesh(file, convex_mesh(read_convexes(model)));
          }};
}

}  // namespace splatboost
