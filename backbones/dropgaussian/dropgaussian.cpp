// SPDX-License-Identifier: Apache-2.0
#include "dropgaussian/dropgaussian.h"

#include <vector>

#include "families/gaussians/gaussian_backbone.h"
#include "splatboost/array.h"
#include "splatboost/dropout.h"
#include "splatboost/elementwise.h"
#include "splatboost/random.h"
#include "trainer/backbone_api/backbone_entry.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_fields.h"

namespace splatboost {
namespace {

constexpr const char* kName = "dropgaussian";

template <class Config, class Visit>
void for_each_field(Config& config, Visit&& visit) {
  for_each_gaussian_field(config, visit);
  visit("drop_rate", config.drop_rate);
}

class DropGaussian final : public GaussianMethod {
 public:
  DropGaussian(const BackboneContext& context, const DropGaussianConfig& config)
      : device_(context.device),
        seed_(context.seed),
        iterations_(context.iterations),
        config_(config),
        factors_(device_),
        opacities_(device_),
        opacity_gradients_(device_) {}

  std::string_view name() const override { return kName; }
  nlohmann::json config() const override { return to_json(config_); }

  LossForm loss() const override {
    // L1 + λ·(1 − SSIM) of the clamped image: the weight of L1 is 1, not 1 − λ.
    const double whole = 1 + config_.lambda_dssim;
    return {static_cast<float>(config_.lambda_dssim / whole), static_cast<float>(whole), true};
  }

  void draw(Gaussians& drawn, const DrawContext& context) override;
  void redirect(GaussianGradients& gradients) override {
    opacity_gradients_.assign_zeros(factors_.size());
    gradients.opacities = opacity_gradients_;
  }
  void add_gradients(const GaussianGradients& activated) override {
    add_products(opacity_gradients_, factors_, activated.opacities, device_);
  }

  float views_seen(bool compact_box) const override {
    // With the square of 3DGS a dropped Gaussian counts as seen, with a zero gradient. With the compact box it is not
    // listed; the views in which it is kept then count more, so that the expected mean gradient is the same.
    return compact_box ? 1 / (1 - static_cast<float>(rate_)) : 1.0f;
  }

 private:
  Device device_;
  std::uint64_t seed_;
  int iterations_;
  DropGaussianConfig config_;

  double rate_ = 0;  ///< drop rate in the last training view
  Array<float> factors_, opacities_, opacity_gradients_;
};

void DropGaussian::draw(Gaussians& drawn, const DrawContext& context) {
  if (context.purpose != DrawPurpose::train) return;
  rate_ = config_.drop_rate * context.iteration / iterations_;
  factors_.ensure(drawn.count);
  opacities_.ensure(drawn.count);
  draw_dropout(seed_, context.iteration, rate_, factors_, device_);
  multiply(drawn.opacities, factors_, opacities_, device_);
  drawn.opacities = opacities_;
}

}  // namespace

void draw_dropout(std::uint64_t seed, int iteration, double rate, std::span<float> factors, Device device) {
  dropout_factors(RandomStream(seed, static_cast<std::uint64_t>(iteration), RandomPurpose::dropout), rate, factors,
                  device);
}

nlohmann::json to_json(const DropGaussianConfig& config) {
  return fields_to_json([&](auto&& visit) { for_each_field(config, visit); });
}

DropGaussianConfig dropgaussian_config_from_json(const nlohmann::json& json) {
  DropGaussianConfig config;
  fields_from_json(json, std::string("backbone ") + kName, [&](auto&& visit) { for_each_field(config, visit); });
  check_gaussian_config(config, kName);
  require(config.drop_rate >= 0 && config.drop_rate < 1,
          std::string("config of backbone ") + kName + ": drop_rate must lie in [0, 1)");
  return config;
}

std::unique_ptr<Backbone> make_dropgaussian(const BackboneContext& context, const DropGaussianConfig& config) {
  return make_gaussian_backbone(context, config, std::make_unique<DropGaussian>(context, config));
}

BackboneEntry dropgaussian_entry() {
  return {"dropgaussian", DropGaussianConfig().published_iterations,
          [](const BackboneContext& context, const nlohmann::json& constants) {
            return make_dropgaussian(context, dropgaussian_config_from_json(constants));
          }};
}

}  // namespace splatboost
