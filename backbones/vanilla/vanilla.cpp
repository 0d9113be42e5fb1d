// SPDX-License-Identifier: Apache-2.0
#include "vanilla/vanilla.h"

#include "families/gaussians/gaussian_backbone.h"
#include "trainer/backbone_api/backbone_entry.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_fields.h"

namespace splatboost {
namespace {

constexpr std::string_view kRelease2023 = "2023", kRelease2024 = "2024";

template <class Config, class Visit>
void for_each_field(Config& config, Visit&& visit) {
  visit("release", config.release);
  for_each_gaussian_field(config, visit);
}

/// Defaults of a release.
VanillaConfig config_of_release(const std::string& release) {
  VanillaConfig config;
  config.release = release;
  if (release == kRelease2024) config.opacity_rate = 0.025;
  return config;
}

class Vanilla final : public GaussianMethod {
 public:
  explicit Vanilla(const VanillaConfig& config) : config_(config) {}
  std::string_view name() const override { return "vanilla"; }
  nlohmann::json config() const override { return to_json(config_); }
  LossForm loss() const override {
    return {static_cast<float>(config_.lambda_dssim), 1, config_.release == kRelease2024};
  }

 private:
  VanillaConfig config_;
};

}  // namespace

nlohmann::json to_json(const VanillaConfig& config) {
  return fields_to_json([&](auto&& visit) { for_each_field(config, visit); });
}

VanillaConfig vanilla_config_from_json(const nlohmann::json& json) {
  // Read twice, because the defaults depend on the release.
  VanillaConfig config;
  const auto read = [&] {
    fields_from_json(json, "backbone vanilla", [&](auto&& visit) { for_each_field(config, visit); });
  };
  read();
  require(config.release == kRelease2023 || config.release == kRelease2024,
          "config of backbone vanilla: release must be \"2023\" or \"2024\"");
  config = config_of_release(config.release);
  read();
  check_gaussian_config(config, "vanilla");
  return config;
}

std::unique_ptr<Backbone> make_vanilla(const BackboneContext& context, const VanillaConfig& config) {
  return make_gaussian_backbone(context, config, std::make_unique<Vanilla>(config));
}

BackboneEntry vanilla_entry() {
  return {"vanilla", kPublishedIterations, [](const BackboneContext& context, const nlohmann::json& constants) {
            return make_vanilla(context, vanilla_config_from_json(constants));
          }};
}

}  // namespace splatboost
