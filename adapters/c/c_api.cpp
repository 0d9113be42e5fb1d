// SPDX-License-Identifier: Apache-2.0
#include "splatboost/c_api.h"

#include <cmath>

#include "c/c_api_edge.h"
#include "splatboost/adam.h"
#include "splatboost/clearance.h"
#include "splatboost/error_map.h"
#include "splatboost/neighbors.h"
#include "splatboost/rasterizer.h"
#include "splatboost/schedule.h"
#include "splatboost/scores.h"
#include "splatboost/select.h"
#include "splatboost/ssim.h"
#include "splatboost/visibility.h"

namespace edge = splatboost::edge;
using edge::guarded;
using edge::guarded_on;
using edge::kAny;
using edge::need;
using edge::OnHost;
using edge::Place;
using edge::size_of;

namespace {

/// Properties of the Gaussians of a forward pass that the passes after it rely on.
struct DrawnShape {
  std::size_t count = 0;
  bool covariances = false, colors = false;
  int sh_degree = 0, sh_rest_rows = 0, features = 0;
  bool operator==(const DrawnShape&) const = default;
};

DrawnShape shape_of(const splatboost::Gaussians& g) {
  return {g.count, !g.covariances.empty(), !g.colors.empty(), g.sh_degree, g.sh_rest_rows, g.features_per_gaussian};
}

}  // namespace

struct sb_rasterizer {
  explicit sb_rasterizer(const sb_device* device)
      : place(device), rasterizer([&] {
          const Place::Call call(place, device != nullptr ? device->stream : nullptr);
          return splatboost::Rasterizer(place.device());
        }()) {}

  Place place;
  splatboost::Rasterizer rasterizer;
  bool drawn = false;  ///< whether the last forward pass succeeded
  DrawnShape shape;
  std::int64_t width = 0, height = 0;

  void check_drawn(const char* what) const {
    if (!drawn) throw splatboost::ArgumentError(std::string(what) + " needs a successful forward before it");
  }
};

int32_t sb_abi_version(void) { return SB_ABI_VERSION; }
const char* sb_version(void) { return SPLATBOOST_VERSION; }

int32_t sb_has_device(int32_t kind) {
  return kind == SB_CPU || (kind == SB_CUDA && splatboost::cuda_device_count() > 0) ? 1 : 0;
}

const char* sb_cuda_architectures(void) { return splatboost::cuda_architectures(); }

sb_status sb_cuda_activity(int64_t* allocations, int64_t* waits) {
  return guarded([&] {
    const splatboost::CudaActivity total = splatboost::CudaStream::total_activity();
    if (allocations != nullptr) *allocations = static_cast<std::int64_t>(total.allocations);
    if (waits != nullptr) *waits = static_cast<std::int64_t>(total.synchronizations);
  });
}

sb_status sb_raster_options_default(sb_raster_options* options) {
  return guarded([&] {
    const splatboost::RasterOptions defaults;
    sb_raster_options& o = need(options, "options");
    o = {};
    o.box = defaults.box == splatboost::BoxPolicy::square ? SB_BOX_SQUARE : SB_BOX_ELLIPSE;
    o.beta = defaults.beta;
    o.low_pass = defaults.low_pass;
    o.compensate_opacity = defaults.compensate_opacity ? 1 : 0;
    o.near_plane = defaults.near_plane;
    for (int c = 0; c < 3; ++c) o.background[c] = defaults.background[c];
  });
}

sb_status sb_rasterizer_create(const sb_device* device, sb_rasterizer** rasterizer) {
  return guarded([&] {
    need(rasterizer, "rasterizer") = nullptr;
    *rasterizer = new sb_rasterizer(device);
  });
}

void sb_rasterizer_destroy(sb_rasterizer* rasterizer) { delete rasterizer; }

sb_status sb_rasterizer_forward(sb_rasterizer* rasterizer, const sb_camera* camera, const sb_gaussians* gaussians,
                                const sb_raster_options* options, const sb_raster_outputs* outputs, void* stream) {
  return guarded([&] {
    sb_rasterizer& r = need(rasterizer, "rasterizer");
    const sb_raster_outputs& to = need(outputs, "outputs");
    Place& place = r.place;
    const Place::Call call(place, stream);
    const splatboost::Camera view = edge::camera_of(camera);
    const splatboost::Gaussians in = place.gaussians(gaussians, true);
    const splatboost::RasterOptions how = edge::options_of(options);
    const std::int64_t w = view.width, h = view.height, n = static_cast<std::int64_t>(in.count);
    splatboost::RasterImages images;
    images.color = place.optional_view<float>(to.color, "color", {3, h, w});
    images.features = place.optional_view<float>(to.features, "features", {in.features_per_gaussian, h, w});
    images.inverse_depth = place.optional_view<float>(to.inverse_depth, "inverse_depth", {{1, h, w}, {h, w}});
    images.alpha = place.optional_view<float>(to.alpha, "alpha", {{1, h, w}, {h, w}});
    const auto radii = place.optional_view<std::int32_t>(to.radii, "radii", {n});
    const auto visible = place.optional_view<std::uint8_t>(to.visible, "visible", {n});

    r.drawn = false;
    r.rasterizer.forward(view, in, how, images);
    if (!radii.empty()) edge::copy(r.rasterizer.screen_radii(), radii, place.device());
    if (!visible.empty()) edge::copy(r.rasterizer.visible(), visible, place.device());
    r.shape = shape_of(in);
    r.width = w;
    r.height = h;
    r.drawn = true;
  });
}

sb_status sb_rasterizer_backward(sb_rasterizer* rasterizer, const sb_gaussians* gaussians,
                                 const sb_image_gradients* image_gradients, const sb_gaussian_gradients* gradients,
                                 void* stream) {
  return guarded([&] {
    sb_rasterizer& r = need(rasterizer, "rasterizer");
    const sb_image_gradients& from = need(image_gradients, "image_gradients");
    const sb_gaussian_gradients& to = need(gradients, "gradients");
    Place& place = r.place;
    const Place::Call call(place, stream);
    r.check_drawn("backward");
    const splatboost::Gaussians in = place.gaussians(gaussians, true);
    if (!(shape_of(in) == r.shape)) throw splatboost::ArgumentError("backward needs the Gaussians of the last forward");
    const std::int64_t w = r.width, h = r.height, n = static_cast<std::int64_t>(in.count);
    const std::int64_t f = in.features_per_gaussian;

    splatboost::RasterImageGradients images;
    images.color = place.optional_view<const float>(from.color, "gradient of color", {3, h, w});
    images.features = place.optional_view<const float>(from.features, "gradient of features", {f, h, w});
    images.inverse_depth =
        place.optional_view<const float>(from.inverse_depth, "gradient of inverse_depth", {{1, h, w}, {h, w}});
    images.alpha = place.optional_view<const float>(from.alpha, "gradient of alpha", {{1, h, w}, {h, w}});

    splatboost::GaussianGradients out;
    out.mode = to.accumulate != 0 ? splatboost::GradientMode::accumulate : splatboost::GradientMode::overwrite;
    out.means = place.optional_view<float>(to.means, "gradients.means", {n, 3});
    out.scales = place.optional_view<float>(to.scales, "gradients.scales", {n, 3});
    out.rotations = place.optional_view<float>(to.rotations, "gradients.rotations", {n, 4});
    out.covariances = place.optional_view<float>(to.covariances, "gradients.covariances", {n, 6});
    out.opacities = place.optional_view<float>(to.opacities, "gradients.opacities", {{n}, {n, 1}});
    out.sh_dc = place.optional_view<float>(to.sh_dc, "gradients.sh_dc", {{n, 3}, {n, 1, 3}});
    out.sh_rest = place.optional_view<float>(to.sh_rest, "gradients.sh_rest", {n, in.sh_rest_rows, 3});
    out.colors = place.optional_view<float>(to.colors, "gradients.colors", {n, 3});
    out.features = place.optional_view<float>(to.features, "gradients.features", {n, f});
    out.screen_means = place.optional_view<float>(to.screen_means, "gradients.screen_means", {n, 2});
    out.screen_means_abs = place.optional_view<float>(to.screen_means_abs, "gradients.screen_means_abs", {n, 2});
    r.rasterizer.backward(in, images, out);
  });
}

sb_status sb_rasterizer_count_flagged(sb_rasterizer* rasterizer, const sb_tensor* flagged, const sb_tensor* counts,
                                      void* stream) {
  return guarded([&] {
    sb_rasterizer& r = need(rasterizer, "rasterizer");
    const Place::Call call(r.place, stream);
    r.check_drawn("count_flagged");
    r.rasterizer.count_flagged(
        r.place.view<const std::uint8_t>(flagged, "flagged", {r.height, r.width}),
        r.place.view<std::int32_t>(counts, "counts", {static_cast<std::int64_t>(r.shape.count)}));
  });
}

sb_status sb_rasterizer_count_observed(sb_rasterizer* rasterizer, float min_transmittance, const sb_tensor* counts,
                                       void* stream) {
  return guarded([&] {
    sb_rasterizer& r = need(rasterizer, "rasterizer");
    const Place::Call call(r.place, stream);
    r.check_drawn("count_observed");
    r.rasterizer.count_observed(
        min_transmittance, r.place.view<std::int32_t>(counts, "counts", {static_cast<std::int64_t>(r.shape.count)}));
  });
}

sb_status sb_rasterizer_add_weights(sb_rasterizer* rasterizer, const sb_tensor* weights, void* stream) {
  return guarded([&] {
    sb_rasterizer& r = need(rasterizer, "rasterizer");
    const Place::Call call(r.place, stream);
    r.check_drawn("add_weights");
    r.rasterizer.add_weights(
        r.place.view<std::int32_t>(weights, "weights", {static_cast<std::int64_t>(r.shape.count)}));
  });
}

sb_status sb_rasterizer_settle(sb_rasterizer* rasterizer, int32_t* redrawn, void* stream) {
  return guarded([&] {
    sb_rasterizer& r = need(rasterizer, "rasterizer");
    const Place::Call call(r.place, stream);
    r.check_drawn("settle");
    const bool again = r.rasterizer.settle();
    if (redrawn != nullptr) *redrawn = again ? 1 : 0;
  });
}

sb_status sb_rasterizer_counts(sb_rasterizer* rasterizer, int64_t* visible, int64_t* entries, void* stream) {
  return guarded([&] {
    sb_rasterizer& r = need(rasterizer, "rasterizer");
    const Place::Call call(r.place, stream);
    r.check_drawn("counts");
    const splatboost::RasterCounts counts = r.rasterizer.counts();
    if (visible != nullptr) *visible = static_cast<std::int64_t>(counts.visible);
    if (entries != nullptr) *entries = static_cast<std::int64_t>(counts.tile_entries);
  });
}

sb_status sb_mark_visible(const sb_device* device, const sb_camera* camera, const sb_tensor* means, float near_plane,
                          const sb_tensor* visible) {
  return guarded_on(device, [&](Place& place) {
    const std::int64_t n = size_of(means, "means");
    splatboost::mark_visible(edge::camera_of(camera), place.view<const float>(means, "means", {n, 3}), near_plane,
                             place.view<std::uint8_t>(visible, "visible", {n}), place.device());
  });
}

sb_status sb_visible_radii(const sb_device* device, const sb_camera* camera, const sb_gaussians* gaussians,
                           const sb_raster_options* options, const sb_tensor* radii) {
  return guarded_on(device, [&](Place& place) {
    const splatboost::Gaussians in = place.gaussians(gaussians, false);
    splatboost::visible_radii(edge::camera_of(camera), in, edge::options_of(options),
                              place.view<std::int32_t>(radii, "radii", {static_cast<std::int64_t>(in.count)}),
                              place.device());
  });
}

sb_status sb_flag_errors(const sb_device* device, const sb_tensor* render, const sb_truth* truth, float tau,
                         const sb_tensor* error, const sb_tensor* flagged, int64_t* count) {
  return guarded_on(device, [&](Place& place) {
    const auto drawn = place.view<const float>(render, "render", {3, kAny, kAny});
    const splatboost::TruthImage image = place.truth(truth, render);
    const splatboost::ErrorCounts found = splatboost::flag_errors(
        drawn, image, tau, place.view<float>(error, "error", {image.height, image.width}),
        place.view<std::uint8_t>(flagged, "flagged", {image.height, image.width}), place.device());
    if (count != nullptr) *count = static_cast<std::int64_t>(found.flagged);
  });
}

sb_status sb_photometric_loss(const sb_device* device, const sb_tensor* render, const sb_truth* truth,
                              float lambda_dssim, const sb_tensor* gradient, sb_loss* loss) {
  return guarded_on(device, [&](Place& place) {
    sb_loss& to = need(loss, "loss");
    const auto drawn = place.view<const float>(render, "render", {3, kAny, kAny});
    const splatboost::TruthImage image = place.truth(truth, render);
    const auto out = place.optional_view<float>(gradient, "gradient", {3, image.height, image.width});
    const splatboost::PhotometricLoss value = place.photometric().evaluate(drawn, image, lambda_dssim, out);
    to = {value.l1, value.ssim, value.total};
  });
}

sb_status sb_ssim(const sb_device* device, const sb_tensor* images, const sb_tensor* truths, int32_t valid_padding,
                  const sb_tensor* gradient, const sb_tensor* mean) {
  return guarded_on(device, [&](Place& place) {
    const auto to = place.view<double>(mean, "mean", {1});
    const auto from = place.view<const float>(images, "images", {kAny, kAny, kAny, kAny});
    const std::int64_t* s = images->shape;
    const auto wanted = place.view<const float>(truths, "truths", {s[0], s[1], s[2], s[3]});
    const auto out = place.optional_view<float>(gradient, "gradient", {s[0], s[1], s[2], s[3]});
    SPLATBOOST_CHECK(!from.empty(), "images must have at least one pixel");
    SPLATBOOST_CHECK(s[2] < (1 << 30) && s[3] < (1 << 30), "images: width and height must be below 2^30");
    splatboost::SsimPlanes planes;
    planes.count = static_cast<std::size_t>(s[0] * s[1]);
    planes.height = static_cast<int>(s[2]);
    planes.width = static_cast<int>(s[3]);
    const auto padding = valid_padding != 0 ? splatboost::SsimPadding::valid : splatboost::SsimPadding::same;
    if (place.is_cuda()) {
      splatboost::ssim(planes, from, wanted, padding, out, to, place.ssim_workspace());
    } else {
      to[0] = splatboost::ssim(planes, from, wanted, padding, out, place.device().threads());
    }
  });
}

sb_status sb_importance_scores(const sb_device* device, const sb_tensor* counts, int32_t views,
                               const sb_tensor* scores) {
  return guarded_on(device, [&](Place& place) {
    SPLATBOOST_CHECK(views >= 0, "views must not be negative");
    const std::int64_t n = size_of(counts, "counts");
    const auto from = place.view<const std::int64_t>(counts, "counts", {n});
    const auto to = place.view<std::int64_t>(scores, "scores", {n});
    splatboost::importance_scores(from, views, to, place.device());
  });
}

sb_status sb_pruning_scores(const sb_device* device, const sb_tensor* weighted_counts, const sb_tensor* scores) {
  return guarded_on(device, [&](Place& place) {
    const std::int64_t n = size_of(weighted_counts, "weighted_counts");
    const auto from = place.view<const double>(weighted_counts, "weighted_counts", {n});
    const auto to = place.view<float>(scores, "scores", {n});
    if (!place.is_cuda()) {
      for (const double v : from) SPLATBOOST_CHECK(std::isfinite(v), "weighted_counts must be finite");
    }
    splatboost::pruning_scores(from, to, place.device());
  });
}

sb_status sb_keep_important(const sb_device* device, const sb_tensor* importance, double threshold,
                            const sb_tensor* candidates, int64_t* kept) {
  return guarded_on(device, [&](Place& place) {
    const std::int64_t n = size_of(importance, "importance");
    const auto by = place.view<const std::int64_t>(importance, "importance", {n});
    const auto mask = place.view<std::uint8_t>(candidates, "candidates", {n});
    const std::size_t left = splatboost::keep_important(by, threshold, mask, place.device());
    if (kept != nullptr) *kept = static_cast<std::int64_t>(left);
  });
}

sb_status sb_keep_weighted_sample(const sb_device* device, const sb_tensor* weights, int64_t keep, uint64_t seed,
                                  uint64_t iteration, const sb_tensor* candidates) {
  return guarded_on(device, [&](Place& place) {
    SPLATBOOST_CHECK(keep >= 0, "keep must not be negative");
    const std::int64_t n = size_of(weights, "weights");
    const auto by = place.view<const float>(weights, "weights", {n});
    const auto mask = place.view<std::uint8_t>(candidates, "candidates", {n});
    const splatboost::RandomStream random(seed, iteration, splatboost::RandomPurpose::prune);
    const auto room = static_cast<std::size_t>(keep);
    splatboost::keep_weighted_sample(by, room, random, mask, place.device());
  });
}

sb_status sb_keep_largest(const sb_device* device, const sb_tensor* priorities, int64_t keep,
                          const sb_tensor* candidates) {
  return guarded_on(device, [&](Place& place) {
    SPLATBOOST_CHECK(keep >= 0, "keep must not be negative");
    const std::int64_t n = size_of(priorities, "priorities");
    const auto from = place.view<const float>(priorities, "priorities", {n});
    const auto mask = place.view<std::uint8_t>(candidates, "candidates", {n});
    const auto room = static_cast<std::size_t>(keep);
    splatboost::keep_largest(from, room, mask, place.device());
  });
}

sb_status sb_spare_one(const sb_device* device, const sb_tensor* priorities, const sb_tensor* removals,
                       int64_t* removed) {
  return guarded_on(device, [&](Place& place) {
    const std::int64_t n = size_of(priorities, "priorities");
    const auto by = place.view<const float>(priorities, "priorities", {n});
    const auto mask = place.view<std::uint8_t>(removals, "removals", {n});
    const std::size_t left = splatboost::spare_one(by, mask, place.device());
    if (removed != nullptr) *removed = static_cast<std::int64_t>(left);
  });
}

sb_status sb_adam_step(const sb_device* device, const sb_tensor* values, const sb_tensor* gradients,
                       const sb_tensor* first_moments, const sb_tensor* second_moments, int64_t step,
                       const sb_adam_options* options) {
  return guarded_on(device, [&](Place& place) {
    const sb_adam_options& o = need(options, "options");
    const auto any_shape = [&](const sb_tensor* tensor, const char* name) {
      return place.view<float>(tensor, name, {{kAny}, {kAny, kAny}, {kAny, kAny, kAny}, {kAny, kAny, kAny, kAny}});
    };
    const auto rate = [](float v) { return v >= 0.0f && v < 1.0f; };
    SPLATBOOST_CHECK(std::isfinite(o.learning_rate), "learning_rate must be finite");
    SPLATBOOST_CHECK(rate(o.beta1) && rate(o.beta2), "beta1 and beta2 must lie in [0, 1)");
    SPLATBOOST_CHECK(o.epsilon >= 0.0f && std::isfinite(o.epsilon), "epsilon must be finite and not negative");
    splatboost::adam_step(any_shape(values, "values"), any_shape(gradients, "gradients"),
                          any_shape(first_moments, "first_moments"), any_shape(second_moments, "second_moments"), step,
                          {o.learning_rate, o.beta1, o.beta2, o.epsilon}, place.device());
  });
}

sb_status sb_mean_squared_neighbor_distances(const sb_device* device, const sb_tensor* points, int32_t k,
                                             const sb_tensor* distances) {
  return guarded_on(device, [&](Place& place) {
    SPLATBOOST_CHECK(k >= 1 && k <= 64, "k must be 1 to 64, not " + std::to_string(k));
    const std::int64_t n = size_of(points, "points");
    splatboost::mean_squared_neighbor_distances(place.view<const float>(points, "points", {n, 3}), k,
                                                place.view<float>(distances, "distances", {n}), place.device());
  });
}

sb_status sb_distances_to_scene(const sb_device* device, const sb_tensor* centres, const sb_tensor* points,
                                const sb_tensor* distances) {
  return guarded_on(device, [&](Place& place) {
    const std::int64_t cameras = size_of(centres, "centres"), count = size_of(points, "points");
    OnHost from(place.view<const float>(centres, "centres", {cameras, 3}), place.device());
    OnHost to(place.view<const float>(points, "points", {count, 3}), place.device());
    OnHost found(place.view<float>(distances, "distances", {cameras}), place.device());
    splatboost::distances_to_scene(from.span(), to.span(), found.span(), place.host_threads());
    found.write_back();
  });
}

sb_status sb_camera_clearances(const sb_device* device, const sb_tensor* means, const sb_tensor* centres,
                               const sb_tensor* distances, const sb_tensor* clearances) {
  return guarded_on(device, [&](Place& place) {
    const std::int64_t n = size_of(means, "means"), cameras = size_of(centres, "centres");
    splatboost::camera_clearances(place.view<const float>(means, "means", {n, 3}),
                                  place.view<const float>(centres, "centres", {cameras, 3}),
                                  place.view<const float>(distances, "distances", {cameras}),
                                  place.view<float>(clearances, "clearances", {n}), place.device());
  });
}

sb_status sb_steps_at(const sb_step_intervals* intervals, int32_t iteration, int32_t total, int32_t* steps) {
  return guarded([&] {
    const sb_step_intervals& i = need(intervals, "intervals");
    SPLATBOOST_CHECK(i.early > 0 && i.middle > 0 && i.late > 0, "intervals must be above 0");
    SPLATBOOST_CHECK(total > 0, "total must be above 0");
    const splatboost::StepIntervals wanted{i.early, i.middle, i.late, i.early_end, i.middle_end};
    need(steps, "steps") = splatboost::steps_at(wanted, {iteration, total}) ? 1 : 0;
  });
}

sb_status sb_scaled_iteration(int32_t published, int32_t total, int32_t published_total, int32_t* iteration) {
  return guarded([&] {
    int32_t& to = need(iteration, "iteration");
    SPLATBOOST_CHECK(published_total <= 0 || static_cast<double>(published) * total / published_total < 2147483647.0,
                     "the iteration is beyond 2^31");
    to = splatboost::scaled_iteration(published, total, published_total);
  });
}

sb_status sb_exponential_rate(double initial, double final_value, int32_t iteration, int32_t steps, double* rate) {
  return guarded([&] { need(rate, "rate") = splatboost::exponential_rate(initial, final_value, iteration, steps); });
}
