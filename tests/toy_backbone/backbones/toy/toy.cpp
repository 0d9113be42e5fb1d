// SPDX-License-Identifier: Apache-2.0
// A tenth backbone: 3DGS whose published run is 2 000 iterations long, with one configurable constant.
#include "families/gaussians/gaussian_backbone.h"
#include "families/gaussians/gaussian_config.h"
#include "families/gaussians/gaussian_method.h"
#include "trainer/backbone_api/backbone_entry.h"
#include "trainer/support/json_fields.h"

namespace splatboost {
namespace {

struct ToyConfig : GaussianConfig {
  ToyConfig() { published_iterations = 2000; }
};

template <class Config, class Visit>
void for_each_toy_field(Config& config, Visit&& visit) {
  visit("scaling_rate", config.scaling_rate);
}

class Toy final : public GaussianMethod {
 public:
  explicit Toy(const ToyConfig& config) : config_(config) {}
  std::string_view name() const override { return "toy"; }
  nlohmann::json config() const override {
    return fields_to_json([&](auto&& visit) { for_each_toy_field(config_, visit); });
  }
  LossForm loss() const override { return {static_cast<float>(config_.lambda_dssim), 1}; }

 private:
  ToyConfig config_;
};

}  // namespace

BackboneEntry toy_entry() {
  return {"toy", ToyConfig().published_iterations, [](const BackboneContext& context, const nlohmann::json& constants) {
            ToyConfig config;
            fields_from_json(constants, "backbone toy", [&](auto&& visit) { for_each_toy_field(config, visit); });
            return make_gaussian_backbone(context, config, std::make_unique<Toy>(config));
          }};
}

}  // namespace splatboost
