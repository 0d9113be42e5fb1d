// SPDX-License-Identifier: Apache-2.0
#include "deformable_3dgs/deformable_3dgs.h"

#include <algorithm>
#include <string>
#include <vector>

#include "deformable_3dgs/deformation_field.h"
#include "families/gaussians/gaussian_backbone.h"
#include "splatboost/array.h"
#include "splatboost/random.h"
#include "trainer/backbone_api/backbone_entry.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_fields.h"

namespace splatboost {
namespace {

constexpr const char* kName = "deformable-3dgs";

template <class Config, class Visit>
void for_each_field(Config& config, Visit&& visit) {
  for_each_gaussian_field(config, visit);
  visit("is_blender", config.is_blender);
  visit("is_6dof", config.is_6dof);
  visit("warm_up", config.warm_up);
  visit("deform_rate_initial", config.deform_rate_initial);
  visit("deform_rate_final", config.deform_rate_final);
  visit("time_noise", config.time_noise);
  visit("time_noise_until", config.time_noise_until);
  visit("net_layers", config.net_layers);
  visit("net_width", config.net_width);
}

DeformationShape shape_of(const DeformableConfig& config) {
  DeformationShape shape;
  shape.time_frequencies = config.is_blender ? 6 : 10;
  shape.time_net = config.is_blender;
  shape.rigid = config.is_6dof;
  shape.layers = static_cast<std::size_t>(config.net_layers);
  shape.width = static_cast<std::size_t>(config.net_width);
  return shape;
}

class Deformable final : public GaussianMethod {
 public:
  Deformable(const BackboneContext& context, const DeformableConfig& config)
      : device_(context.device),
        seed_(context.seed),
        iterations_(context.iterations),
        config_(config),
        shape_(shape_of(config)),
        time_interval_(mean_time_interval(context.scene.train)),
        field_(shape_, device_),
        net_(
            "deformation", 1, device_,
            [this](int iteration) {
              return exponential_rate(config_.deform_rate_initial, config_.deform_rate_final, iteration, iterations_);
            },
            Activation::none, GroupShape::dense),
        moving_(
            "moves", 1, device_, [](int) { return 0.0; }, Activation::none, GroupShape::dense),
        means_(device_),
        scales_(device_),
        rotations_(device_),
        mean_gradients_(device_),
        scale_gradients_(device_),
        rotation_gradients_(device_) {}

  std::string_view name() const override { return kName; }
  nlohmann::json config() const override { return to_json(config_); }
  LossForm loss() const override { return {static_cast<float>(config_.lambda_dssim), 1}; }
  MethodStages stages() const override { return {"net_forward", "net_backward"}; }
  std::size_t bytes_per_gaussian() const override { return DeformationField::bytes_per_gaussian(shape_); }

  std::vector<TrainedGroup*> groups() override { return {&net_, &moving_}; }
  void start(std::span<const float>) override {
    net_.assign(initial_deformation(shape_, RandomStream(seed_, 0, RandomPurpose::net_parameters)));
    moving_.assign({0.0f});
  }
  bool import_from(const SplatCloud& cloud) override {
    imported_moving_ = moving_.values.to_host()[0] > 0;
    return GaussianMethod::import_from(cloud);
  }

  bool uses_time() const override { return true; }
  void gaussians_changed(std::span<const float>) override { drawn_at_.reset(); }
  void activated(std::span<const float>, std::span<const float>) override { drawn_at_.reset(); }
  void draw(Gaussians& drawn, const DrawContext& context) override;
  void redirect(GaussianGradients& gradients) override;
  void add_gradients(const GaussianGradients& activated) override;

  bool grows_by_absolute_gradients() const override { return true; }

 private:
  int at(int published) const { return scaled_iteration(published, iterations_, config_.published_iterations); }

  Device device_;
  std::uint64_t seed_;
  int iterations_;
  DeformableConfig config_;
  DeformationShape shape_;
  double time_interval_;
  DeformationField field_;
  TrainedGroup net_;

  TrainedGroup moving_;                  ///< 1 once the net moves Gaussians; stored because models have no iteration
  std::optional<bool> imported_moving_;  ///< of an imported model

  bool moves_ = false;             ///< whether the last draw() applied the net
  std::optional<float> drawn_at_;  ///< time of the moved Gaussians; none: they are out of date
  GaussianPlaces<const float> canonical_;
  Array<float> means_, scales_, rotations_;  ///< deformed
  Array<float> mean_gradients_, scale_gradients_, rotation_gradients_;
};

void Deformable::draw(Gaussians& drawn, const DrawContext& context) {
  moves_ = imported_moving_.value_or(context.iteration >= at(config_.warm_up));
  if (!moves_) return;
  if (context.iteration == at(config_.warm_up) && !imported_moving_) moving_.assign({1.0f});
  const bool trains = context.purpose == DrawPurpose::train;
  float time = context.time;
  if (trains && !config_.is_blender) {
    time += static_cast<float>(
        smoothing_noise(config_, time_interval_, context.iteration, at(config_.time_noise_until), seed_));
  }
  // Consecutive scored views of the same time reuse the Gaussians. Other purposes always run the net, so that render
  // times of an evaluation include it.
  if (context.purpose != DrawPurpose::score || drawn_at_ != time) {
    canonical_ = {drawn.means, drawn.scales, drawn.rotations};
    means_.ensure(drawn.means.size());
    scales_.ensure(drawn.scales.size());
    rotations_.ensure(drawn.rotations.size());
    field_.forward(net_.values, canonical_, time, {means_, scales_, rotations_}, trains);
    drawn_at_ = time;
  }
  drawn.means = means_;
  drawn.scales = scales_;
  drawn.rotations = rotations_;
}

void Deformable::redirect(GaussianGradients& gradients) {
  if (!moves_) return;
  mean_gradients_.assign_zeros(means_.size());
  scale_gradients_.assign_zeros(scales_.size());
  rotation_gradients_.assign_zeros(rotations_.size());
  gradients.means = mean_gradients_;
  gradients.scales = scale_gradients_;
  gradients.rotations = rotation_gradients_;
}

void Deformable::add_gradients(const GaussianGradients& activated) {
  if (!moves_) return;
  field_.backward(net_.values, canonical_, {mean_gradients_, scale_gradients_, rotation_gradients_},
                  {activated.means, activated.scales, activated.rotations}, net_.gradients);
  net_.pending = true;
}

}  // namespace

double mean_time_interval(const std::vector<View>& views) {
  std::vector<float> times;
  times.reserve(views.size());
  for (const View& view : views) times.push_back(view.time);
  std::ranges::sort(times);
  times.erase(std::unique(times.begin(), times.end()), times.end());
  if (times.size() < 2) return 0;
  return static_cast<double>(times.back() - times.front()) / static_cast<double>(times.size() - 1);
}

double smoothing_noise(const DeformableConfig& config, double interval, int iteration, int until, std::uint64_t seed) {
  const double share = std::max(0.0, 1 - static_cast<double>(iteration) / until);
  const RandomStream random(seed, static_cast<std::uint64_t>(iteration), RandomPurpose::time_noise);
  return random.normal(0) * interval * config.time_noise * share;
}

void require_times(const Scene& scene) {
  require(mean_time_interval(scene.train) > 0,
          std::string(kName) + ": all " + std::to_string(scene.train.size()) +
              " training views have the same time, so no motion can be learned; use a dataset with times "
              "(docs/formats.md lists the supported ones), --frame-times if the names of COLMAP's images end in frame "
              "numbers, or another --backbone");
}

nlohmann::json to_json(const DeformableConfig& config) {
  return fields_to_json([&](auto&& visit) { for_each_field(config, visit); });
}

DeformableConfig deformable_config_from_json(const nlohmann::json& json, const DeformableConfig& defaults) {
  DeformableConfig config = defaults;
  fields_from_json(json, std::string("backbone ") + kName, [&](auto&& visit) { for_each_field(config, visit); });
  check_gaussian_config(config, kName);
  const std::string what = std::string("config of backbone ") + kName + ": ";
  require(config.warm_up >= 0, what + "warm_up must be at least 0");
  require(config.deform_rate_initial > 0 && config.deform_rate_final > 0, what + "deform rates must be above 0");
  require(config.time_noise >= 0, what + "time_noise must be at least 0");
  require(config.time_noise_until >= 1, what + "time_noise_until must be at least 1");
  require(config.net_layers >= 1 && config.net_layers <= 64, what + "net_layers must be 1 to 64");
  require(config.net_width >= 1 && config.net_width <= 4096, what + "net_width must be 1 to 4096");
  return config;
}

std::unique_ptr<Backbone> make_deformable(const BackboneContext& context, const DeformableConfig& config) {
  return make_gaussian_backbone(context, config, std::make_unique<Deformable>(context, config));
}

BackboneEntry deformable_3dgs_entry() {
  return {kName, DeformableConfig().published_iterations,
          [](const BackboneContext& context, const nlohmann::json& constants) {
            DeformableConfig defaults;
            defaults.is_blender = context.scene.synthetic;
            return make_deformable(context, deformable_config_from_json(constants, defaults));
          },
          nullptr, require_times};
}

}  // namespace splatboost
