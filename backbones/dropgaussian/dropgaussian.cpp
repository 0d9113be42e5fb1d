// SPDX-License-Identifier: Apache-2.0
#include "dropgaussian/dropgaussian.h"

#include <vector>

#include "common/input_error.h"
#include "common/json_fields.h"
#include "gaussians/gaussian_backbone.h"
#include "splatboost/random.h"

namespace splatboost {
namespace {

constexpr const char* kName = "dropgaussian";
constexpr std::size_t kGrain = 4096;

template <class Config, class Visit>
void for_each_field(Config& config, Visit&& visit) {
  for_each_gaussian_field(config, visit);
  visit("drop_rate", config.drop_rate);
}

class DropGaussian final : public GaussianMethod {
 public:
  DropGaussian(const BackboneContext& context, const DropGaussianConfig& config)
      : threads_(context.threads), seed_(context.seed), iterations_(context.iterations), config_(config) {}

  std::string_view name() const override { return kName; }
  nlohmann::json config() const override { return to_json(config_); }

  LossForm loss() const override {
    // L1 + λ·(1 − SSIM): L1 keeps its full weight.
    const double whole = 1 + config_.lambda_dssim;
    return {static_cast<float>(config_.lambda_dssim / whole), static_cast<float>(whole)};
  }

  void draw(Gaussians& drawn, std::optional<int> training) override;
  void redirect(GaussianGradients& gradients) override {
    opacity_gradients_.assign(factors_.size(), 0.0f);
    gradients.opacities = opacity_gradients_;
  }
  void add_gradients(const GaussianGradients& activated) override {
    for (std::size_t i = 0; i < factors_.size(); ++i) activated.opacities[i] += opacity_gradients_[i] * factors_[i];
  }

  float views_seen(bool compact_box) const override {
    // In 3DGS's square a dropped Gaussian counts as seen, without a gradient. The compact box does not list it: each
    // view where it was kept then stands for those where it was not, so that the mean is the same on average.
    return compact_box ? 1 / (1 - static_cast<float>(rate_)) : 1.0f;
  }

 private:
  Threads& threads_;
  std::uint64_t seed_;
  int iterations_;
  DropGaussianConfig config_;

  double rate_ = 0;  ///< of the last training view
  std::vector<float> factors_, opacities_, opacity_gradients_;
};

void DropGaussian::draw(Gaussians& drawn, std::optional<int> training) {
  if (!training) return;
  rate_ = config_.drop_rate * *training / iterations_;
  factors_.resize(drawn.count);
  opacities_.resize(drawn.count);
  draw_dropout(seed_, *training, rate_, factors_, threads_);
  for (std::size_t i = 0; i < drawn.count; ++i) opacities_[i] = drawn.opacities[i] * factors_[i];
  drawn.opacities = opacities_;
}

}  // namespace

void draw_dropout(std::uint64_t seed, int iteration, double rate, std::span<float> factors, Threads& threads) {
  const RandomStream random(seed, static_cast<std::uint64_t>(iteration), RandomPurpose::dropout);
  const auto kept = static_cast<float>(1 / (1 - rate));
  threads.for_range(factors.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) factors[i] = random.uniform(i) < rate ? 0.0f : kept;
  });
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

}  // namespace splatboost
