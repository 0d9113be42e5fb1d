// SPDX-License-Identifier: Apache-2.0
/// @file Minimal methods of explicit Gaussians that exercise the interface of the families.
#pragma once

#include <algorithm>
#include <memory>
#include <string_view>
#include <vector>

#include "families/gaussians/gaussian_backbone.h"
#include "splatboost/array.h"
#include "splatboost/elementwise.h"

namespace splatboost::testing {

/// A config for runs of about 60 iterations, which grow every four iterations.
inline GaussianConfig eager_toy_config() {
  GaussianConfig config;
  config.densify_interval = 4;
  return config;
}

class ToyMethod : public GaussianMethod {
 public:
  std::string_view name() const override { return "toy"; }
  nlohmann::json config() const override { return nlohmann::json::object(); }
  LossForm loss() const override { return {0.2f, 1}; }
};

/// Gaussians of the half space x > 0 move away from the origin and rotate over time.
class MovingMethod : public ToyMethod {
 public:
  static constexpr float kMotion = 0.4f;
  static constexpr float kTurn = 0.8f;  ///< relative change of the quaternion's w by time 1

  explicit MovingMethod(Device device)
      : device_(device),
        mean_factors_(device),
        rotation_factors_(device),
        means_(device),
        rotations_(device),
        mean_gradients_(device),
        rotation_gradients_(device) {}

  void gaussians_changed(std::span<const float> means) override {
    const std::vector<float> at = copy_to_host(means, device_);
    moves_.clear();
    for (std::size_t i = 0; i < at.size(); i += 3) moves_.push_back(at[i] > 0 ? 1.0f : 0.0f);
  }
  void draw(Gaussians& drawn, const DrawContext& context) override {
    contexts.push_back(context);
    std::vector<float> of_means, of_rotations;
    for (const float moves : moves_) {
      of_means.insert(of_means.end(), 3, 1 + kMotion * context.time * moves);
      of_rotations.insert(of_rotations.end(), {1 + kTurn * context.time * moves, 1, 1, 1});
    }
    mean_factors_.assign(std::move(of_means));
    rotation_factors_.assign(std::move(of_rotations));
    means_.ensure(drawn.means.size());
    rotations_.ensure(drawn.rotations.size());
    multiply(drawn.means, mean_factors_, means_, device_);
    multiply(drawn.rotations, rotation_factors_, rotations_, device_);
    drawn.means = means_;
    drawn.rotations = rotations_;
  }
  void redirect(GaussianGradients& gradients) override {
    mean_gradients_.assign_zeros(means_.size());
    rotation_gradients_.assign_zeros(rotations_.size());
    gradients.means = mean_gradients_;
    gradients.rotations = rotation_gradients_;
  }
  void add_gradients(const GaussianGradients& activated) override {
    add_products(mean_gradients_, mean_factors_, activated.means, device_);
    add_products(rotation_gradients_, rotation_factors_, activated.rotations, device_);
  }
  void save(ArchiveWriter& archive) const override { archive.put("toy.moves", std::span<const float>(moves_)); }
  void load(const ArchiveReader& archive, std::size_t) override { moves_ = archive.floats("toy.moves"); }

  std::vector<DrawContext> contexts;  ///< of all draws so far

 private:
  Device device_;
  std::vector<float> moves_;  ///< [N] 1 or 0
  Array<float> mean_factors_, rotation_factors_, means_, rotations_, mean_gradients_, rotation_gradients_;
};

/// A moving method with a loss of its own, summed over its one or two views: mean squared colour error, mean squared
/// inverse depth and mean alpha. The second view, if any, is the training view after the first.
class OwnLossMethod : public MovingMethod {
 public:
  OwnLossMethod(Device device, const Scene& scene, bool two_views, float weight = 1, LossForm form = {0.2f, 0})
      : MovingMethod(device), device_(device), scene_(scene), two_views_(two_views), weight_(weight), form_(form) {}

  LossForm loss() const override { return form_; }
  LossInputs loss_inputs(const DrawContext& first) override {
    LossInputs inputs;
    inputs.inverse_depth = inputs.alpha = true;
    if (two_views_)
      inputs.second =
          &scene_.train[static_cast<std::size_t>(first.view - scene_.train.data() + 1) % scene_.train.size()];
    return inputs;
  }
  double add_loss(std::span<const StepView> views) override {
    double sum = 0;
    for (const StepView& view : views) {
      const std::vector<std::uint8_t> truth = copy_to_host(view.truth.color, device_);
      sum += add(
          view.images.color, view.gradients.color, [&](std::size_t p) { return truth[p] / 255.0f; }, 1);
      sum += add(
          view.images.inverse_depth, view.gradients.inverse_depth, [](std::size_t) { return 0.0f; }, 1);
      sum += add(
          view.images.alpha, view.gradients.alpha, [](std::size_t) { return 0.0f; }, 0);
    }
    return sum;
  }

 private:
  /// Adds weight · mean of (image − target)² if squares is 1, else of (image − target). @return the loss
  template <class Target>
  double add(std::span<const float> image, std::span<float> gradient, const Target& target, int squares) {
    const std::vector<float> values = copy_to_host(image, device_);
    std::vector<float> sums = copy_to_host(std::span<const float>(gradient), device_);
    const float share = weight_ / static_cast<float>(values.size());
    double loss = 0;
    for (std::size_t p = 0; p < values.size(); ++p) {
      const float difference = values[p] - target(p);
      loss += static_cast<double>(share * (squares == 1 ? difference * difference : difference));
      sums[p] += share * (squares == 1 ? 2 * difference : 1);
    }
    if (device_.is_cuda()) {
      device_.stream().copy_to_device(gradient.data(), sums.data(), gradient.size_bytes());
    } else {
      std::ranges::copy(sums, gradient.begin());
    }
    return loss;
  }

  Device device_;
  const Scene& scene_;
  bool two_views_;
  float weight_;
  LossForm form_;
};

/// Every ten iterations removes all Gaussians with opacity below 0.11, in addition to what growth removes.
class TrimmingMethod : public ToyMethod {
 public:
  static constexpr float kFaint = 0.11f;
  bool trims_at(Moment moment) const override { return moment.iteration % 10 == 0; }
  void trim(const DensityStatistics& statistics, ViewDrawer&, std::span<std::uint8_t> remove) override {
    for (std::size_t i = 0; i < remove.size(); ++i) remove[i] = statistics.opacities[i] < kFaint;
  }
};

/// Has parameter groups of its own: a factor for each opacity, a constant label for each Gaussian, and, dense, a shift
/// of all means.
class OwnGroupsMethod : public ToyMethod {
 public:
  explicit OwnGroupsMethod(Device device)
      : device_(device),
        factors_{"factors", 1, device, [](int) { return 0.05; }, Activation::sigmoid},
        labels_{"labels", 1, device, [](int) { return 0.0; }},
        shift_{"shift", 1, device, [](int iteration) { return 1e-3 / iteration; }, Activation::none, GroupShape::dense},
        opacities_(device),
        means_(device),
        mean_gradients_(device),
        opacity_gradients_(device) {}

  std::vector<TrainedGroup*> groups() override { return {&factors_, &labels_, &shift_}; }
  void start(std::span<const float> means) override {
    const std::vector<float> at = copy_to_host(means, device_);
    std::vector<float> labels;
    for (std::size_t i = 0; i < at.size(); i += 3) labels.push_back(at[i]);
    factors_.assign(std::vector<float>(labels.size(), 2.0f));
    labels_.assign(std::move(labels));
    shift_.assign({0.01f, -0.02f, 0.03f});
  }
  void draw(Gaussians& drawn, const DrawContext&) override {
    activated_opacities_ = drawn.opacities;
    opacities_.ensure(drawn.count);
    multiply(drawn.opacities, factors_.drawn(), opacities_, device_);
    drawn.opacities = opacities_;
    std::vector<float> means = copy_to_host(drawn.means, device_);
    const std::vector<float> shift = shift_.values.to_host();
    for (std::size_t k = 0; k < means.size(); ++k) means[k] += shift[k % 3];
    means_.assign(std::move(means));
    drawn.means = means_;
  }
  void redirect(GaussianGradients& gradients) override {
    mean_gradients_.assign_zeros(means_.size());
    opacity_gradients_.assign_zeros(opacities_.size());
    gradients.means = mean_gradients_;
    gradients.opacities = opacity_gradients_;
  }
  void add_gradients(const GaussianGradients& activated) override {
    add_products(opacity_gradients_, factors_.drawn(), activated.opacities, device_);
    add_products(opacity_gradients_, activated_opacities_, factors_.gradients, device_);
    const Array<float> ones(device_, std::vector<float>(means_.size(), 1.0f));
    add_products(mean_gradients_, ones, activated.means, device_);
    const std::vector<float> gradients = mean_gradients_.to_host();
    shift_.gradients.edit(0, [&](std::span<float> sums) {
      for (std::size_t k = 0; k < gradients.size(); ++k) sums[k % 3] += gradients[k];
    });
    factors_.pending = labels_.pending = shift_.pending = true;
  }

 private:
  Device device_;
  TrainedGroup factors_, labels_, shift_;
  std::span<const float> activated_opacities_;
  Array<float> opacities_, means_, mean_gradients_, opacity_gradients_;
};

/// Sets the times of the training and test views, evenly in [0, 1).
inline void spread_times(Scene& scene) {
  for (auto* views : {&scene.train, &scene.test}) {
    for (std::size_t v = 0; v < views->size(); ++v) {
      (*views)[v].time = static_cast<float>(v) / static_cast<float>(views->size());
    }
  }
}

}  // namespace splatboost::testing
