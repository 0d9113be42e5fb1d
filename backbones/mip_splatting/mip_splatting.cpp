// SPDX-License-Identifier: Apache-2.0
#include "mip_splatting/mip_splatting.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "families/gaussians/gaussian_backbone.h"
#include "splatboost/array.h"
#include "splatboost/select.h"
#include "splatboost/smoothing.h"
#include "trainer/backbone_api/backbone_entry.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_fields.h"

namespace splatboost {
namespace {

constexpr const char* kName = "mip-splatting";

template <class Config, class Visit>
void for_each_field(Config& config, Visit&& visit) {
  for_each_gaussian_field(config, visit);
  visit("low_pass", config.low_pass);
  visit("smoothing_variance", config.smoothing_variance);
  visit("visibility_margin", config.visibility_margin);
  visit("smoothing_interval", config.smoothing_interval);
}

std::vector<Camera> cameras_of(const std::vector<View>& views) {
  std::vector<Camera> cameras;
  cameras.reserve(views.size());
  for (const View& view : views) cameras.push_back(view.camera);
  return cameras;
}

class MipSplatting final : public GaussianMethod {
 public:
  MipSplatting(const BackboneContext& context, const MipSplattingConfig& config)
      : device_(context.device),
        config_(config),
        smoothing_(cameras_of(context.scene.train), config.smoothing_variance, config.visibility_margin, device_),
        filters_(device_),
        smooth_scales_(device_),
        smooth_opacities_(device_),
        factors_(device_),
        scale_gradients_(device_),
        opacity_gradients_(device_) {}

  std::string_view name() const override { return kName; }
  nlohmann::json config() const override { return to_json(config_); }
  LossForm loss() const override { return {static_cast<float>(config_.lambda_dssim), 1}; }

  RasterOptions raster_options() const override {
    RasterOptions options;
    options.low_pass = static_cast<float>(config_.low_pass);
    options.compensate_opacity = true;
    return options;
  }

  void gaussians_changed(std::span<const float> means) override {
    filters_.resize(means.size() / 3);
    smoothing_.compute(means, filters_);
  }
  bool renews_at(Moment moment) const override {
    // The filter is constant in the last interval, so that the Gaussians converge under the filter that the model is
    // rendered with.
    return moment.iteration % config_.smoothing_interval == 0 &&
           moment.iteration < moment.total - config_.smoothing_interval;
  }
  void activated(std::span<const float> scales, std::span<const float> opacities) override {
    smooth_scales_.ensure(scales.size());
    smooth_opacities_.ensure(opacities.size());
    factors_.ensure(opacities.size());
    smooth_gaussians(scales, opacities, filters_, smoothed(), device_);
  }
  void draw(Gaussians& drawn, const DrawContext& /*context*/) override {
    scales_ = drawn.scales;
    drawn.scales = smooth_scales_;
    drawn.opacities = smooth_opacities_;
  }
  void redirect(GaussianGradients& gradients) override {
    scale_gradients_.assign_zeros(smooth_scales_.size());
    opacity_gradients_.assign_zeros(smooth_opacities_.size());
    gradients.scales = scale_gradients_;
    gradients.opacities = opacity_gradients_;
  }
  void add_gradients(const GaussianGradients& activated) override {
    smooth_gaussians_backward(scales_, filters_, smoothed(), {scale_gradients_, opacity_gradients_}, activated.scales,
                              activated.opacities, device_);
  }

  bool needs_absolute_gradients() const override { return true; }
  AbsoluteNorm absolute_norm() const override { return AbsoluteNorm::sum; }
  void add_growing(const DensityStatistics& statistics, std::span<std::uint8_t> growing,
                   std::span<float> priorities) const override;
  std::span<const float> opacity_factors() const override { return factors_; }

  void save(ArchiveWriter& archive) const override {
    std::vector<float> copy;
    archive.put("mip-splatting.filters", filters_.on_host(copy));
  }
  void load(const ArchiveReader& archive, std::size_t count) override {
    filters_.assign(archive.floats("mip-splatting.filters"));
    require(filters_.size() == count,
            archive.path().string() + ": the number of filters does not match; the checkpoint is damaged");
  }
  void export_to(SplatCloud& cloud) const override { cloud.filters = filters_.to_host(); }
  bool import_from(const SplatCloud& cloud) override {
    filters_.assign(cloud.filters);
    return !filters_.empty();
  }

 private:
  SmoothedGaussians smoothed() { return {smooth_scales_, smooth_opacities_, factors_}; }

  Device device_;
  MipSplattingConfig config_;
  SmoothingFilters smoothing_;

  Array<float> filters_;  ///< [N] standard deviations
  std::span<const float> scales_;
  Array<float> smooth_scales_, smooth_opacities_, factors_;
  Array<float> scale_gradients_, opacity_gradients_;
};

void MipSplatting::add_growing(const DensityStatistics& statistics, std::span<std::uint8_t> growing,
                               std::span<float> priorities) const {
  // Choose the threshold so that as many Gaussians pass it by the absolute gradient as grow by the signed one.
  const auto by_signed = static_cast<double>(std::count(growing.begin(), growing.end(), 1));
  const float threshold =
      quantile(statistics.gradients_abs, 1 - by_signed / static_cast<double>(std::max<std::size_t>(growing.size(), 1)));
  for (std::size_t i = 0; i < growing.size(); ++i) {
    if (statistics.gradients_abs[i] < threshold) continue;
    const float priority = growth_priority(statistics.gradients_abs[i], threshold);
    priorities[i] = growing[i] != 0 ? std::max(priorities[i], priority) : priority;
    growing[i] = 1;
  }
}

}  // namespace

float quantile(std::span<const float> values, double q) {
  if (values.empty()) return 0;
  std::vector<float> sorted(values.begin(), values.end());
  const double place = std::clamp(q, 0.0, 1.0) * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::ptrdiff_t>(place);
  std::nth_element(sorted.begin(), sorted.begin() + below, sorted.end());
  const float low = sorted[static_cast<std::size_t>(below)];
  const auto rest = sorted.begin() + below + 1;
  if (rest == sorted.end()) return low;
  const auto fraction = static_cast<float>(place - static_cast<double>(below));
  return low + fraction * (*std::min_element(rest, sorted.end()) - low);
}

nlohmann::json to_json(const MipSplattingConfig& config) {
  return fields_to_json([&](auto&& visit) { for_each_field(config, visit); });
}

MipSplattingConfig mip_splatting_config_from_json(const nlohmann::json& json) {
  MipSplattingConfig config;
  fields_from_json(json, std::string("backbone ") + kName, [&](auto&& visit) { for_each_field(config, visit); });
  check_gaussian_config(config, kName);
  const std::string what = std::string("config of backbone ") + kName + ": ";
  require(config.low_pass > 0, what + "low_pass must be above 0");
  require(config.smoothing_variance >= 0, what + "smoothing_variance must be at least 0");
  require(config.visibility_margin >= 0, what + "visibility_margin must be at least 0");
  require(config.smoothing_interval > 0, what + "smoothing_interval must be above 0");
  return config;
}

std::unique_ptr<Backbone> make_mip_splatting(const BackboneContext& context, const MipSplattingConfig& config) {
  return make_gaussian_backbone(context, config, std::make_unique<MipSplatting>(context, config));
}

BackboneEntry mip_splatting_entry() {
  return {"mip-splatting", kPublishedIterations, [](const BackboneContext& context, const nlohmann::json& constants) {
            return make_mip_splatting(context, mip_splatting_config_from_json(constants));
          }};
}

}  // namespace splatboost
