// SPDX-License-Identifier: Apache-2.0
#include "pgsr/pgsr.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "families/gaussians/gaussian_backbone.h"
#include "pgsr/neighbor_views.h"
#include "splatboost/array.h"
#include "splatboost/elementwise.h"
#include "splatboost/errors.h"
#include "splatboost/exposure.h"
#include "splatboost/gaussian_planes.h"
#include "splatboost/photometric.h"
#include "splatboost/random.h"
#include "splatboost/select.h"
#include "splatboost/surface_depth.h"
#include "splatboost/surface_loss.h"
#include "splatboost/truth_store.h"
#include "trainer/backbone_api/backbone_entry.h"
#include "trainer/backbone_api/memory_estimate.h"
#include "trainer/backbone_api/training_truths.h"
#include "trainer/dataset/scene_depths.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr const char* kName = "pgsr";
constexpr double kNearDepth = 0.1;      ///< nearer points are not compared; for scenes seen from kPublishedDepth
constexpr double kMinSimilarity = 0.5;  ///< SSIM above which exposure is compensated

class Pgsr final : public GaussianMethod {
 public:
  Pgsr(const BackboneContext& context, const PgsrConfig& config)
      : scene_(context.scene),
        device_(context.device),
        seed_(context.seed),
        iterations_(context.iterations),
        config_(config),
        unit_(config.absolute_distances ? 1.0 : typical_depth(context.scene) / kPublishedDepth),
        neighbors_(
            neighbor_views(context.scene.train, {config.max_neighbors, config.neighbor_angle,
                                                 unit_ * config.neighbor_nearest, unit_ * config.neighbor_farthest})),
        exposures_(
            "exposure", 2, device_, [rate = config.exposure_rate](int) { return rate; }, Activation::none,
            GroupShape::dense),
        surface_loss_(device_),
        planes_(device_),
        plane_gradients_(device_),
        flatness_sums_(device_, {0.0, 0.0}),
        radii_(device_),
        observed_(device_),
        patch_photos_{{{}, 0, device_}, {{}, 0, device_}},
        photometric_(device_),
        no_exposure_(device_, {0.0f, 0.0f}),
        exposure_gradients_(device_, {0.0f, 0.0f}),
        exposure_sums_(device_, std::vector<double>(4, 0.0)) {
    exposures_.in_model = false;  // they belong to photos of this scene, and renders do not apply them
  }

  std::string_view name() const override { return kName; }
  nlohmann::json config() const override { return to_json(config_); }
  /// The second view of a step is drawn besides, and planes with their gradients in both.
  std::size_t bytes_per_gaussian() const override { return drawn_memory_bytes() + 2 * kPlaneChannels * sizeof(float); }
  std::size_t bytes_per_pixel() const override {
    constexpr std::size_t kPlanes = 2 * 2 * (kPlaneChannels + 1) * sizeof(float);  // with alpha
    return pixel_memory_bytes() + kPlanes + SurfaceLoss::bytes_per_pixel();
  }

  std::vector<TrainedGroup*> groups() override {
    return config_.exposure ? std::vector<TrainedGroup*>{&exposures_} : std::vector<TrainedGroup*>{};
  }
  void start(std::span<const float> /*means*/) override {
    exposures_.assign(std::vector<float>(2 * scene_.train.size(), 0.0f));
  }

  // Loss.

  LossForm loss() const override { return {static_cast<float>(config_.lambda_dssim), exposes_ ? 0.0f : 1.0f}; }
  LossInputs loss_inputs(const DrawContext& first) override;
  double add_loss(std::span<const StepView> views) override;

  // Rendering.

  void draw(Gaussians& drawn, const DrawContext& context) override;
  void redirect(GaussianGradients& gradients) override {
    if (!draws_planes_) return;
    plane_gradients_.assign_zeros(planes_.size());
    gradients.features = plane_gradients_;
  }
  void add_gradients(const GaussianGradients& activated) override;
  void compensate(std::span<float> color, const View& view) override;
  bool surface_depth(std::span<const float> features, const Camera& camera, std::span<float> depth) override {
    plane_depth(camera, features, depth, device_);
    return true;
  }
  double photo_scale() const override { return config_.photometric_weight > 0 ? config_.ncc_scale : 1; }
  bool trains_surfaces() const override { return true; }

  // Density control.

  bool needs_absolute_gradients() const override { return true; }
  void add_growing(const DensityStatistics& statistics, std::span<std::uint8_t> growing,
                   std::span<float> priorities) const override;
  void gather(Rasterizer& rasterizer) override;
  void restart_statistics(std::size_t count) override { radii_.assign_zeros(count); }
  bool scatters_clones() const override { return true; }
  bool trims_at(Moment moment) const override {
    const int interval = std::max(at(config_.trim_interval), static_cast<int>(scene_.train.size()));
    return config_.trim_views > 0 && moment.iteration < at(config_.densify_until) && moment.iteration % interval == 0;
  }
  void trim(const DensityStatistics& statistics, ViewDrawer& views, std::span<std::uint8_t> remove) override;

  void save(ArchiveWriter& archive) const override {
    std::vector<float> radii;
    for (const std::int32_t radius : radii_.to_host()) radii.push_back(static_cast<float>(radius));
    archive.put("pgsr.radii", std::span<const float>(radii));
  }
  void load(const ArchiveReader& archive, std::size_t count) override {
    std::vector<std::int32_t> radii;
    for (const float radius : archive.floats("pgsr.radii")) radii.push_back(static_cast<std::int32_t>(radius));
    require(radii.size() == count,
            archive.path().string() + ": the number of radii does not match; the checkpoint is damaged");
    radii_.assign(std::move(radii));
  }

 private:
  int at(int published) const { return scaled_iteration(published, iterations_, config_.published_iterations); }
  RandomStream random(int iteration, RandomPurpose purpose) const {
    return {seed_, static_cast<std::uint64_t>(iteration), purpose};
  }
  const View* second_view(const DrawContext& first);
  /// The photo of a view in which patches are compared, if that is not the one it is trained on.
  std::optional<PatchPhoto> patch_photo(const StepView& view, TruthStore& memory) const;
  /// Exposure parameters [2] of a training view or its half-size view; empty for other views.
  std::span<float> exposure_of(const View& view, Array<float>& rows) const;
  double add_exposed_loss(const StepView& first);

  const Scene& scene_;
  Device device_;
  std::uint64_t seed_;
  int iterations_;
  PgsrConfig config_;
  double unit_;                                      ///< world units per length unit of the settings
  std::vector<std::vector<std::size_t>> neighbors_;  ///< [training views]
  TrainedGroup exposures_;                           ///< [training views,2] log gain and offset
  SurfaceLoss surface_loss_;

  // State of the current step.
  View virtual_view_;
  bool has_surfaces_ = false;  ///< whether surface terms are used
  bool exposes_ = false;       ///< whether the loss compensates exposure
  bool flattens_ = false;      ///< whether add_gradients() must add those of flatness

  // State of the last draw().
  bool draws_planes_ = false;
  Gaussians drawn_;
  Camera camera_;
  Array<float> planes_, plane_gradients_;  ///< [N,4]

  Array<double> flatness_sums_;
  std::span<const std::uint8_t> visible_;          ///< [N] in the first view
  Array<std::int32_t> radii_;                      ///< [N] largest screen radius since the last growth, px
  Array<std::int32_t> observed_;                   ///< [N] number of pixels of a view that observe a Gaussian
  TruthStore patch_photos_[2];                     ///< memory for those of the views of a step
  Photometric photometric_;                        ///< for views with exposure
  Array<float> no_exposure_, exposure_gradients_;  ///< for views without compensation
  Array<double> exposure_sums_;
};

LossInputs Pgsr::loss_inputs(const DrawContext& first) {
  has_surfaces_ = first.iteration > at(config_.surface_from);
  exposes_ = config_.exposure && first.iteration > at(config_.exposure_from);
  LossInputs inputs;
  inputs.features = inputs.alpha = has_surfaces_;
  inputs.second_color = false;
  const bool compares = config_.geometric_weight > 0 || config_.photometric_weight > 0;
  if (has_surfaces_ && compares) inputs.second = second_view(first);
  return inputs;
}

const View* Pgsr::second_view(const DrawContext& first) {
  const std::optional<std::size_t> index = training_index(scene_, *first.view);
  if (!index) return nullptr;
  const std::vector<std::size_t>& neighbors = neighbors_[*index];
  const RandomStream numbers = random(first.iteration, RandomPurpose::neighbor_view);
  if (config_.virtual_cameras && (neighbors.empty() || numbers.uniform(1) < 0.5)) {
    virtual_view_ = virtual_view(*first.view, unit_ * config_.neighbor_farthest, config_.neighbor_angle,
                                 random(first.iteration, RandomPurpose::virtual_camera));
    return &virtual_view_;
  }
  if (neighbors.empty()) return nullptr;
  const std::size_t chosen = neighbors[numbers.below(0, neighbors.size())];
  const bool half = first.view != &scene_.train[*index];
  return half ? &scene_.train_halves[chosen] : &scene_.train[chosen];
}

double Pgsr::add_loss(std::span<const StepView> views) {
  const StepView& first = views.front();
  double loss = 0;
  if (exposes_) loss += add_exposed_loss(first);
  if (config_.flatness_weight > 0) {
    flattens_ = true;
    visible_ = first.visible;
    flatness_loss(drawn_.scales, visible_, static_cast<float>(config_.flatness_weight), flatness_sums_, device_);
    if (!device_.is_cuda()) loss += flatness_sums_.host()[0];  // not on a GPU, where reading it would synchronise
  }
  if (!has_surfaces_) return loss;
  const auto photo_of = [&](const StepView& view, TruthStore& memory) {
    return views.size() > 1 ? patch_photo(view, memory) : std::nullopt;  // one view has nothing to compare with
  };
  const std::optional<PatchPhoto> patches[2] = {photo_of(first, patch_photos_[0]),
                                                photo_of(views.back(), patch_photos_[1])};
  const auto surface_of = [&](const StepView& view, const std::optional<PatchPhoto>& photo) {
    return SurfaceView{view.context.camera,     view.truth,
                       view.images.features,    view.images.alpha,
                       view.gradients.features, photo ? &*photo : nullptr};
  };
  SurfaceTerms terms;
  terms.normal_weight = static_cast<float>(config_.normal_weight);
  terms.edge_aware = config_.edge_aware;
  terms.geometric_weight = static_cast<float>(config_.geometric_weight);
  terms.photometric_weight = static_cast<float>(config_.photometric_weight);
  terms.max_pixel_noise = static_cast<float>(config_.max_pixel_noise);
  terms.max_patches = config_.max_patches;
  terms.near_depth = static_cast<float>(unit_ * kNearDepth);
  const SurfaceView one = surface_of(first, patches[0]), other = surface_of(views.back(), patches[1]);
  return loss + surface_loss_
                    .add(one, views.size() > 1 ? &other : nullptr, terms,
                         random(first.context.iteration, RandomPurpose::patches))
                    .total();
}

std::optional<PatchPhoto> Pgsr::patch_photo(const StepView& view, TruthStore& memory) const {
  if (photo_scale() == 1) return std::nullopt;
  const std::optional<std::size_t> index = training_index(scene_, *view.context.view);
  if (!index) return std::nullopt;  // a virtual camera
  SPLATBOOST_CHECK(*index < scene_.train_rescaled.size(), "ncc_scale needs Scene::train_rescaled");
  const View& photo = scene_.train_rescaled[*index];
  return PatchPhoto{photo.camera, memory.upload(photo.truth())};
}

std::span<float> Pgsr::exposure_of(const View& view, Array<float>& rows) const {
  const std::optional<std::size_t> index = training_index(scene_, view);
  return index ? rows.span().subspan(2 * *index, 2) : std::span<float>();
}

double Pgsr::add_exposed_loss(const StepView& first) {
  // SSIM uses the render; L1 uses the exposed render once the render resembles the photo.
  const auto lambda = static_cast<float>(config_.lambda_dssim);
  // Synchronises on a GPU, because the SSIM of this view decides whether exposure is used.
  const PhotometricLoss measured = photometric_.evaluate(first.images.color, first.truth, 1.0f, first.gradients.color);
  scale(first.gradients.color, lambda, device_);
  const bool resembles = measured.ssim > kMinSimilarity;
  const std::span<float> own = exposure_of(*first.context.view, exposures_.values);
  const bool compensates = resembles && !own.empty();
  add_exposed_l1(first.images.color, first.truth, compensates ? own : no_exposure_.span(), 1 - lambda,
                 first.gradients.color,
                 compensates ? exposure_of(*first.context.view, exposures_.gradients) : exposure_gradients_.span(),
                 exposure_sums_, device_);
  if (compensates) exposures_.pending = true;
  const double l1 = device_.is_cuda() ? (1 - static_cast<double>(lambda)) * measured.l1 : exposure_sums_.host()[0];
  return static_cast<double>(lambda) * (1 - measured.ssim) + l1;
}

void Pgsr::draw(Gaussians& drawn, const DrawContext& context) {
  draws_planes_ = context.purpose == DrawPurpose::surface || (context.purpose == DrawPurpose::train && has_surfaces_);
  if (draws_planes_) {
    planes_.ensure(kPlaneChannels * drawn.count);
    gaussian_planes(drawn, context.camera, planes_, device_);
    drawn.features = planes_;
    drawn.features_per_gaussian = kPlaneChannels;
  }
  drawn_ = drawn;
  camera_ = context.camera;
}

void Pgsr::add_gradients(const GaussianGradients& activated) {
  if (draws_planes_) {
    gaussian_planes_backward(drawn_, camera_, plane_gradients_, activated.means, activated.rotations, device_);
  }
  if (flattens_) {
    flatness_loss_backward(drawn_.scales, visible_, static_cast<float>(config_.flatness_weight), flatness_sums_,
                           activated.scales, device_);
    flattens_ = false;
  }
}

void Pgsr::compensate(std::span<float> color, const View& view) {
  if (!config_.exposure) return;
  const std::span<const float> own = exposure_of(view, exposures_.values);
  if (!own.empty()) expose(color, own, color, device_);
}

void Pgsr::gather(Rasterizer& rasterizer) {
  observed_.assign_zeros(radii_.size());
  rasterizer.count_observed(static_cast<float>(config_.observe_transmittance), observed_);
  add_screen_radii(rasterizer.screen_radii(), std::as_const(observed_), radii_, device_);
}

void Pgsr::add_growing(const DensityStatistics& statistics, std::span<std::uint8_t> growing,
                       std::span<float> priorities) const {
  const std::vector<std::int32_t> radii = radii_.to_host();
  const auto border = static_cast<float>(config_.percent_dense * static_cast<double>(statistics.scene_extent));
  std::vector<std::uint8_t> blurred(growing.size());
  for (std::size_t i = 0; i < growing.size(); ++i) {
    blurred[i] = growing[i] == 0 && statistics.gradients_abs[i] >= static_cast<float>(config_.gradient_abs_threshold) &&
                 statistics.max_scales[i] > border && radii[i] > config_.split_radius;
  }
  keep_largest(statistics.gradients_abs, static_cast<std::size_t>(config_.max_abs_splits), blurred);
  for (std::size_t i = 0; i < growing.size(); ++i) {
    if (blurred[i] == 0) continue;
    growing[i] = 1;
    priorities[i] = growth_priority(statistics.gradients_abs[i], static_cast<float>(config_.gradient_abs_threshold));
  }
}

void Pgsr::trim(const DensityStatistics& /*statistics*/, ViewDrawer& views, std::span<std::uint8_t> remove) {
  std::vector<int> seen(remove.size(), 0);
  std::vector<std::int32_t> copy;
  for (std::size_t v = 0; v < views.views(); ++v) {
    observed_.assign_zeros(remove.size());
    views.draw(v).count_observed(static_cast<float>(config_.observe_transmittance), observed_);
    const std::span<const std::int32_t> counts = observed_.on_host(copy);
    for (std::size_t i = 0; i < seen.size(); ++i) seen[i] += counts[i] > 0 ? 1 : 0;
  }
  // With fewer views than trim_views, no Gaussian could be observed often enough.
  const int least = std::min(config_.trim_views, static_cast<int>(views.views()));
  for (std::size_t i = 0; i < seen.size(); ++i) remove[i] = seen[i] < least;
}

}  // namespace

std::unique_ptr<Backbone> make_pgsr(const BackboneContext& context, const PgsrConfig& config) {
  BackboneContext capped = context;
  const auto most = static_cast<std::size_t>(config.max_gaussians);
  if (most > 0 && (capped.max_primitives == 0 || capped.max_primitives > most)) capped.max_primitives = most;
  return make_gaussian_backbone(capped, config, std::make_unique<Pgsr>(capped, config));
}

BackboneEntry pgsr_entry() {
  return {"pgsr", kPublishedIterations, [](const BackboneContext& context, const nlohmann::json& constants) {
            return make_pgsr(context, pgsr_config_from_json(constants));
          }};
}

}  // namespace splatboost
