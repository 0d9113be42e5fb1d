// SPDX-License-Identifier: Apache-2.0
#include "c/adapters_c.h"

#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "c/c_api_edge.h"
#include "dropgaussian/dropgaussian_adapter.h"
#include "mip_splatting/mip_splatting_adapter.h"
#include "splatboost/hooks.h"
#include "vanilla/vanilla_adapter.h"

namespace edge = splatboost::edge;
using edge::guarded;
using edge::kAny;
using edge::need;
using edge::Place;
using edge::size_of;
using splatboost::ArgumentError;

namespace {

enum class Backbone { vanilla, mip_splatting, dropgaussian };

Backbone backbone_of(const char* name) {
  const std::string_view wanted = &need(name, "backbone");
  if (wanted == "vanilla") return Backbone::vanilla;
  if (wanted == "mip-splatting") return Backbone::mip_splatting;
  if (wanted == "dropgaussian") return Backbone::dropgaussian;
  throw ArgumentError("backbone: \"vanilla\", \"mip-splatting\" or \"dropgaussian\" wanted, \"" +
                      std::string(wanted.substr(0, 100)) + "\" given");
}

splatboost::VanillaBoost boost_of(const sb_boost& b) {
  for (const double v : {b.tau_d, b.gradient_threshold, b.gradient_abs_threshold, b.percent_dense, b.late_min_opacity,
                         b.late_max_score}) {
    SPLATBOOST_CHECK(std::isfinite(v), "boost: thresholds must be finite");
  }
  SPLATBOOST_CHECK(b.tau >= 0.0f && b.tau <= 1.0f, "boost.tau must lie in [0, 1]");
  SPLATBOOST_CHECK(b.lambda_dssim >= 0.0f && b.lambda_dssim <= 1.0f, "boost.lambda_dssim must lie in [0, 1]");
  SPLATBOOST_CHECK(b.published_iterations > 0, "boost.published_iterations must be above 0");
  SPLATBOOST_CHECK(b.late_prune_from >= 0, "boost.late_prune_from must not be negative");
  splatboost::VanillaBoost boost;
  boost.vcd = b.vcd != 0;
  boost.vcp = b.vcp != 0;
  boost.cb = b.cb != 0;
  boost.absgrad = b.absgrad != 0;
  boost.schedule = b.schedule != 0;
  boost.views = b.views;
  boost.beta = b.beta;
  boost.tau = b.tau;
  boost.lambda_dssim = b.lambda_dssim;
  boost.tau_d = b.tau_d;
  boost.gradient_threshold = b.gradient_threshold;
  boost.gradient_abs_threshold = b.gradient_abs_threshold;
  boost.percent_dense = b.percent_dense;
  boost.densify_from = b.densify_from;
  boost.densify_until = b.densify_until;
  boost.densify_interval = b.densify_interval;
  boost.late_prune_from = b.late_prune_from;
  boost.late_prune_interval = b.late_prune_interval;
  boost.late_min_opacity = b.late_min_opacity;
  boost.late_max_score = b.late_max_score;
  boost.seed = b.seed;
  boost.published_iterations = b.published_iterations;
  return boost;
}

std::unique_ptr<splatboost::VanillaAdapter> make_adapter(Backbone backbone, const splatboost::VanillaBoost& boost,
                                                         Place& place) {
  if (backbone == Backbone::mip_splatting) {
    return std::make_unique<splatboost::MipSplattingAdapter>(boost, place.device());
  }
  if (backbone == Backbone::dropgaussian) {
    return std::make_unique<splatboost::DropGaussianAdapter>(boost, place.device());
  }
  return std::make_unique<splatboost::VanillaAdapter>(boost, place.device());
}

splatboost::Moment moment_of(std::int32_t iteration, std::int32_t total) {
  SPLATBOOST_CHECK(iteration >= 0, "iteration must not be negative");
  SPLATBOOST_CHECK(total > 0, "total must be above 0");
  return {iteration, total};
}

template <class T>
sb_tensor tensor_of(std::span<T> values, std::int32_t type, std::initializer_list<std::int64_t> shape,
                    const Place& place) {
  sb_tensor tensor{};
  tensor.data = const_cast<std::remove_const_t<T>*>(values.data());
  tensor.type = type;
  tensor.dimensions = static_cast<std::int32_t>(shape.size());
  std::int64_t stride = static_cast<std::int64_t>(values.size());
  int d = 0;
  for (const std::int64_t size : shape) {
    stride = size > 0 ? stride / size : 0;
    tensor.shape[d] = size;
    tensor.strides[d++] = stride;
  }
  tensor.device_kind = place.kind();
  tensor.device_index = place.index();
  return tensor;
}

/// Values of a tensor where the rules read and write them: in place on the CPU, copied from a GPU.
template <class T>
class OnHost {
 public:
  OnHost(std::span<T> values, splatboost::Device device) : values_(values), device_(device) {
    if (!device.is_cuda()) return;
    copy_.resize(values.size());
    device.stream().copy_to_host(copy_.data(), values.data(), values.size_bytes());
  }
  std::span<T> span() { return device_.is_cuda() ? std::span<T>(copy_) : values_; }
  void write_back() {
    if (device_.is_cuda()) device_.stream().copy_to_device(values_.data(), copy_.data(), values_.size_bytes());
  }

 private:
  std::span<T> values_;
  splatboost::Device device_;
  std::vector<std::remove_const_t<T>> copy_;
};

/// The host's functions as the hook that adapters know.
class HostRenderer final : public splatboost::RasterizerHook {
 public:
  HostRenderer(const sb_views& views, const Place& place) : views_(views), place_(place) {
    SPLATBOOST_CHECK(views.primitives >= 0 && views.views >= 0, "views: primitives and views must not be negative");
    SPLATBOOST_CHECK(views.primitives < (std::int64_t{1} << 31), "views: at most 2^31 primitives");
    SPLATBOOST_CHECK(views.views < (std::int64_t{1} << 24), "views: at most 2^24 views");
    need(views.render, "views.render");
    need(views.count_flagged, "views.count_flagged");
  }

  void set_beta(std::optional<float>) override {}
  std::size_t primitives() const override { return static_cast<std::size_t>(views_.primitives); }
  std::size_t scorable_views() const override { return static_cast<std::size_t>(views_.views); }

  splatboost::ScoredView render_for_score(std::size_t view) override {
    sb_scored_view scored{};
    if (views_.render(views_.context, static_cast<std::int64_t>(view), &scored) != 0) {
      throw edge::CallbackFailed("views.render failed for view " + std::to_string(view));
    }
    splatboost::ScoredView out;
    out.color = place_.view<const float>(scored.color, "color", {3, kAny, kAny});
    out.truth = place_.truth(&scored.truth, scored.color);
    width_ = out.truth.width;
    height_ = out.truth.height;
    return out;
  }

  void count_flagged(std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts) override {
    const sb_tensor mask = tensor_of(flagged, SB_UINT8, {height_, width_}, place_);
    const sb_tensor sums = tensor_of(counts, SB_INT32, {views_.primitives}, place_);
    if (views_.count_flagged(views_.context, &mask, &sums) != 0) {
      throw edge::CallbackFailed("views.count_flagged failed");
    }
  }

 private:
  const sb_views& views_;
  const Place& place_;
  int width_ = 0, height_ = 0;
};

}  // namespace

struct sb_adapter {
  sb_adapter(Backbone backbone, const splatboost::VanillaBoost& wanted, const sb_device* device)
      : place(device), boost(wanted) {
    const Place::Call call(place, device != nullptr ? device->stream : nullptr);
    adapter = make_adapter(backbone, wanted, place);
  }

  Place place;
  splatboost::VanillaBoost boost;
  std::unique_ptr<splatboost::VanillaAdapter> adapter;
  std::int64_t grown = 0;      ///< primitives of the last grow
  std::int32_t grown_at = -1;  ///< its iteration
};

sb_status sb_boost_default(const char* backbone, sb_boost* boost) {
  return guarded([&] {
    const splatboost::VanillaBoost from =
        backbone_of(backbone) == Backbone::dropgaussian ? splatboost::dropgaussian_boost() : splatboost::VanillaBoost{};
    sb_boost& to = need(boost, "boost");
    to = {};
    to.vcd = from.vcd;
    to.vcp = from.vcp;
    to.cb = from.cb;
    to.absgrad = from.absgrad;
    to.schedule = from.schedule;
    to.views = from.views;
    to.beta = from.beta;
    to.tau = from.tau;
    to.lambda_dssim = from.lambda_dssim;
    to.tau_d = from.tau_d;
    to.gradient_threshold = from.gradient_threshold;
    to.gradient_abs_threshold = from.gradient_abs_threshold;
    to.percent_dense = from.percent_dense;
    to.densify_from = from.densify_from;
    to.densify_until = from.densify_until;
    to.densify_interval = from.densify_interval;
    to.late_prune_from = from.late_prune_from;
    to.late_prune_interval = from.late_prune_interval;
    to.late_min_opacity = from.late_min_opacity;
    to.late_max_score = from.late_max_score;
    to.seed = from.seed;
    to.published_iterations = from.published_iterations;
  });
}

sb_status sb_adapter_create(const char* backbone, const sb_boost* boost, const sb_device* device,
                            sb_adapter** adapter) {
  return guarded([&] {
    need(adapter, "adapter") = nullptr;
    const Backbone kind = backbone_of(backbone);
    *adapter = new sb_adapter(kind, boost_of(need(boost, "boost")), device);
  });
}

void sb_adapter_destroy(sb_adapter* adapter) { delete adapter; }

sb_status sb_adapter_beta(const sb_adapter* adapter, float* beta) {
  return guarded([&] { need(beta, "beta") = need(adapter, "adapter").adapter->beta().value_or(0.0f); });
}

sb_status sb_adapter_grows_at(const sb_adapter* adapter, int32_t iteration, int32_t total, int32_t host_would,
                              int32_t* grows) {
  return guarded([&] {
    const sb_adapter& a = need(adapter, "adapter");
    need(grows, "grows") = a.adapter->grows_at(moment_of(iteration, total), host_would != 0) ? 1 : 0;
  });
}

sb_status sb_adapter_prunes_at(const sb_adapter* adapter, int32_t iteration, int32_t total, int32_t host_would,
                               int32_t* prunes) {
  return guarded([&] {
    const sb_adapter& a = need(adapter, "adapter");
    need(prunes, "prunes") = a.adapter->prunes_at(moment_of(iteration, total), host_would != 0) ? 1 : 0;
  });
}

sb_status sb_adapter_steps_at(const sb_adapter* adapter, const char* group, int32_t iteration, int32_t total,
                              int32_t* steps) {
  return guarded([&] {
    const sb_adapter& a = need(adapter, "adapter");
    const std::string_view name = &need(group, "group");
    need(steps, "steps") = a.adapter->steps_at(name, moment_of(iteration, total)) ? 1 : 0;
  });
}

sb_status sb_adapter_grow(sb_adapter* adapter, const sb_density* density, const sb_views* views, const sb_tensor* clone,
                          const sb_tensor* split, void* stream) {
  return guarded([&] {
    sb_adapter& a = need(adapter, "adapter");
    const Place::Call call(a.place, stream);
    const splatboost::Device device = a.place.device();
    const sb_density& d = need(density, "density");
    HostRenderer renderer(need(views, "views"), a.place);
    const std::int64_t n = views->primitives;
    splatboost::DensityStatistics statistics;
    statistics.moment = moment_of(d.iteration, d.total);
    SPLATBOOST_CHECK(d.scene_extent >= 0.0f && std::isfinite(d.scene_extent),
                     "scene_extent must be finite and not negative");
    statistics.scene_extent = d.scene_extent;
    const auto values = [&](const sb_tensor* tensor, const char* name) {
      return OnHost(a.place.view<const float>(tensor, name, {{n}, {n, 1}}), device);
    };
    OnHost gradients = values(d.gradients, "gradients");
    statistics.gradients = gradients.span();
    std::optional<OnHost<const float>> gradients_abs, max_scales;
    if (a.boost.absgrad) {
      statistics.gradients_abs = gradients_abs.emplace(values(d.gradients_abs, "gradients_abs")).span();
      statistics.max_scales = max_scales.emplace(values(d.max_scales, "max_scales")).span();
    }
    OnHost clones(a.place.view<std::uint8_t>(clone, "clone", {n}), device);
    OnHost splits(a.place.view<std::uint8_t>(split, "split", {n}), device);
    splatboost::GrowDecisions decisions{clones.span(), splits.span()};
    a.grown_at = -1;
    a.adapter->grow(statistics, renderer, decisions);
    clones.write_back();
    splits.write_back();
    a.grown = n;
    a.grown_at = d.iteration;
  });
}

sb_status sb_adapter_prune(sb_adapter* adapter, const sb_density* density, const sb_views* views,
                           const sb_tensor* remove, const sb_tensor* origins, void* stream) {
  return guarded([&] {
    sb_adapter& a = need(adapter, "adapter");
    const Place::Call call(a.place, stream);
    const splatboost::Device device = a.place.device();
    const sb_density& d = need(density, "density");
    splatboost::DensityStatistics statistics;
    statistics.moment = moment_of(d.iteration, d.total);
    const std::int64_t n = size_of(remove, "remove");
    SPLATBOOST_CHECK(n < (std::int64_t{1} << 31), "remove: at most 2^31 rows");
    HostRenderer renderer(need(views, "views"), a.place);
    splatboost::PruneDecisions decisions;
    OnHost removals(a.place.view<std::uint8_t>(remove, "remove", {n}), device);
    decisions.remove = removals.span();
    std::vector<std::uint32_t> parents;
    std::optional<OnHost<const float>> opacities;
    if (origins != nullptr) {
      SPLATBOOST_CHECK(a.grown_at == d.iteration, "origins need a grow at the same iteration before");
      OnHost from(a.place.view<const std::int32_t>(origins, "origins", {n}), device);
      for (const std::int32_t origin : from.span()) {
        SPLATBOOST_CHECK(origin >= 0 && origin < a.grown, "origins must be indices of the primitives of the last grow");
        parents.push_back(static_cast<std::uint32_t>(origin));
      }
      decisions.origins = parents;
    } else if (a.boost.vcp) {
      SPLATBOOST_CHECK(views->primitives == n, "views.primitives must be the number of rows of remove");
      opacities.emplace(a.place.view<const float>(d.opacities, "opacities", {{n}, {n, 1}}), device);
      statistics.opacities = opacities->span();
    }
    a.adapter->prune(statistics, renderer, decisions);
    removals.write_back();
  });
}
