// SPDX-License-Identifier: Apache-2.0
#include "families/gaussians/gaussian_trainer.h"

#include <algorithm>

#include "splatboost/elementwise.h"
#include "splatboost/rows.h"
#include "trainer/backbone_api/raster_laps.h"

namespace splatboost {

std::size_t GaussianTrainer::bytes_per_primitive() const {
  std::size_t bytes = gaussian_memory_bytes();
  for (const TrainedGroup* group : row_groups_) {
    const bool known = std::ranges::find(own_groups_, group) != own_groups_.end();
    if (!known) bytes += 4 * sizeof(float) * group->width;  // with gradients and moments
  }
  return bytes + method_->bytes_per_gaussian();
}

void GaussianTrainer::restart_statistics() {
  const std::size_t n = primitives();
  gradient_sum_.assign_zeros(n);
  gradient_abs_sum_.assign_zeros(n);
  seen_.assign_zeros(n);
  method_->restart_statistics(n);
}

void GaussianTrainer::activate() {
  if (!stale_ && !set_changed_) return;
  splatboost::activate(groups_, device_);
  if (set_changed_) method_->gaussians_changed(xyz_.values);
  method_->activated(scaling_.activated, opacity_.activated);
  stale_ = set_changed_ = false;
}

Gaussians GaussianTrainer::activated() const {
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

Gaussians GaussianTrainer::drawn(const DrawContext& context) {
  activate();
  Gaussians gaussians = activated();
  method_->draw(gaussians, context);
  return gaussians;
}

RasterOptions GaussianTrainer::raster_options(std::optional<float> beta) const {
  RasterOptions options = method_->raster_options();
  if (beta) {
    options.box = BoxPolicy::ellipse;
    options.beta = *beta;
  }
  options.background = glm::vec3(context_.scene.white_background ? 1.0f : 0.0f);
  return options;
}

RasterImages GaussianTrainer::ImageSet::of(const Camera& camera, const Gaussians& gaussians, const LossInputs& inputs,
                                           bool with_color) {
  const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  color.ensure(with_color ? 3 * pixels : 0);
  features.ensure(inputs.features ? static_cast<std::size_t>(gaussians.features_per_gaussian) * pixels : 0);
  inverse_depth.ensure(inputs.inverse_depth ? pixels : 0);
  alpha.ensure(inputs.alpha ? pixels : 0);
  return {color, features, inverse_depth, alpha};
}

void GaussianTrainer::ImageSet::clear(bool color_too) {
  if (color_too) color.assign_zeros(color.size());
  for (Array<float>* channel : {&features, &inverse_depth, &alpha}) channel->assign_zeros(channel->size());
}

StepView GaussianTrainer::draw_second(const View& view, int iteration, const LossInputs& inputs) {
  if (!second_) second_ = std::make_unique<SecondView>(device_);
  SecondView& second = *second_;
  // A camera made by the method has no photo.
  StepView step{{view.camera, view.time, iteration, DrawPurpose::train, &view},
                view.color.empty() ? TruthImage{} : truths_.of(view),
                {},
                {},
                {}};
  if (device_.is_cuda()) {
    // Copy, because fetching the truth of the first view may overwrite this one.
    const std::size_t color = step.truth.color.size(), valid = step.truth.valid.size();
    second.truth.ensure(color + valid);
    std::uint8_t* at = second.truth.cuda().data();
    if (color > 0) device_.stream().copy_on_device(at, step.truth.color.data(), color);
    if (valid > 0) device_.stream().copy_on_device(at + color, step.truth.valid.data(), valid);
    step.truth.color = {at, color};
    step.truth.valid = {at + color, valid};
  }
  const Gaussians gaussians = drawn(step.context);
  step.images = second.images.of(view.camera, gaussians, inputs, inputs.second_color);
  step.gradients = second.gradients.of(view.camera, gaussians, inputs, inputs.second_color);
  second.gradients.clear(true);
  second.rasterizer.forward(view.camera, gaussians, raster_options(beta_), step.images);
  step.visible = second.rasterizer.visible();
  return step;
}

double GaussianTrainer::evaluate_loss(std::span<const StepView> views) {
  const LossForm form = method_->loss();
  const StepView& first = views.front();
  gradients_.clear(form.scale == 0);
  double loss = 0;
  if (form.scale != 0) {
    if (form.clamped) clamp_above(images_.color, 1, device_);
    // In the last iteration wait for the loss, so that the run reports the final one.
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

bool GaussianTrainer::rest_steps_soon() const {
  for (int ahead = 0; ahead < static_cast<int>(ShRestGroup::kMaxViews); ++ahead) {
    if (optimizer_ == nullptr || optimizer_->steps_at(f_rest_.name, {iteration_ + ahead, total()})) return true;
  }
  return false;
}

void GaussianTrainer::backward(Rasterizer& rasterizer, const Gaussians& gaussians, const RasterImages& image_gradients,
                               GaussianGradients gradients) {
  gradients.mode = GradientMode::accumulate;
  gradients.means = xyz_.gradients;
  gradients.scales = scaling_.gradients;
  gradients.rotations = rotation_.gradients;
  gradients.opacities = opacity_.gradients;
  if (!image_gradients.color.empty()) {
    gradients.sh_dc = f_dc_.gradients;
    f_rest_.receive(gradients, gaussians.sh_degree, rest_steps_soon());
  }
  const GaussianGradients of_activated = gradients;
  method_->redirect(gradients);
  rasterizer.backward(
      gaussians,
      {image_gradients.color, image_gradients.features, image_gradients.inverse_depth, image_gradients.alpha},
      gradients);
  const bool of_first = &rasterizer == &rasterizer_;
  if (of_first) lap_backward(rasterizer_, device_, clock_);
  method_->add_gradients(of_activated);
  if (const char* const stage = method_->stages().add_gradients; of_first && stage != nullptr) clock_.lap(stage);
}

double GaussianTrainer::train_step(int iteration, const View& view) {
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
  lap_forward(rasterizer_, device_, clock_);

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
    backward(second_->rasterizer, drawn(views[1].context), views[1].gradients, {});
    clock_.lap("second_view");
  }
  if (step_due_groups(groups_, optimizer_, moment(), device_)) stale_ = true;
  average_if_due(groups_, optimizer_, moment(), device_);
  clock_.lap("optimizer");
  control_density();
  // Now rather than before the next view, so that checkpoints include it.
  if (method_->renews_at(moment())) set_changed_ = true;
  if (set_changed_) activate();
  clock_.lap("density");
  return loss;
}

void GaussianTrainer::step_all() {
  if (step_groups(groups_, optimizer_, moment(), device_)) stale_ = true;
  activate();
}

ScoredView GaussianTrainer::render_for_score(std::size_t view) {
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

Rasterizer& GaussianTrainer::draw(std::size_t view) {
  const View& truth = context_.scene.train[view];
  rasterizer_.forward(truth.camera, drawn({truth.camera, truth.time, iteration_, DrawPurpose::score, &truth}),
                      raster_options(beta_), {});
  rasterizer_.settle();
  return rasterizer_;
}

void GaussianTrainer::render_surface(const Camera& camera, float time, std::optional<float> beta,
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
  depths_of_inverse(images.alpha, images.depth);
}

void GaussianTrainer::render(const Camera& camera, float time, std::optional<float> beta, std::span<float> color) {
  RasterImages images;
  if (device_.is_cuda()) images_.color.ensure(color.size());
  images.color = device_.is_cuda() ? images_.color.span() : color;
  rasterizer_.forward(camera, drawn({camera, time, iteration_, DrawPurpose::evaluate}),
                      raster_options(beta ? beta : beta_), images);
  rasterizer_.settle();
  if (device_.is_cuda()) images_.color.cuda().download(color);
}

std::unique_ptr<Backbone> make_gaussian_backbone(const BackboneContext& context, const GaussianConfig& config,
                                                 std::unique_ptr<GaussianMethod> method) {
  return std::make_unique<GaussianTrainer>(context, config, std::move(method));
}

}  // namespace splatboost
