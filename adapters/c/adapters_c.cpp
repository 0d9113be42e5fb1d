// SPDX-License-Identifier: Apache-2.0
#include "c/adapters_c.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <variant>
#include <vector>

#include "c/c_api_edge.h"
#include "registry/boost_settings.h"
#include "splatboost/hooks.h"
#include "splatboost/select.h"

namespace edge = splatboost::edge;
using edge::guarded;
using edge::kAny;
using edge::need;
using edge::OnHost;
using edge::Place;
using edge::size_of;
using splatboost::ArgumentError;

namespace {

splatboost::Moment moment_of(std::int32_t iteration, std::int32_t total) {
  SPLATBOOST_CHECK(iteration >= 0, "iteration must not be negative");
  SPLATBOOST_CHECK(total > 0, "total must be above 0");
  return {iteration, total};
}

std::size_t cap_of(const sb_density& density) {
  SPLATBOOST_CHECK(density.max_primitives >= 0, "max_primitives must not be negative");
  return static_cast<std::size_t>(density.max_primitives);
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

/// Wraps the host's callbacks in a RasterizerHook.
class HostRenderer final : public splatboost::RasterizerHook {
 public:
  /// @param weighs whether add_weights() may be called
  HostRenderer(const sb_views& views, const Place& place, bool weighs) : views_(views), place_(place) {
    SPLATBOOST_CHECK(views.primitives >= 0 && views.views >= 0, "views: primitives and views must not be negative");
    SPLATBOOST_CHECK(views.primitives < (std::int64_t{1} << 31), "views: at most 2^31 primitives");
    SPLATBOOST_CHECK(views.views < (std::int64_t{1} << 24), "views: at most 2^24 views");
    need(views.render, "views.render");
    need(views.count_flagged, "views.count_flagged");
    if (weighs) need(views.add_weights, "views.add_weights");
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

  void add_weights(std::span<std::int32_t> weights) override {
    const sb_tensor sums = tensor_of(weights, SB_INT32, {views_.primitives}, place_);
    if (views_.add_weights(views_.context, &sums) != 0) throw edge::CallbackFailed("views.add_weights failed");
  }

 private:
  const sb_views& views_;
  const Place& place_;
  int width_ = 0, height_ = 0;
};

}  // namespace

struct sb_boost {
  sb_boost(const splatboost::AdapterEntry& of, bool literal)
      : settings(of.make_settings(literal)), fields(settings->settings()) {}

  const splatboost::BoostSettings::Setting& find(const char* name) const {
    const std::string_view wanted = &need(name, "name");
    for (const auto& field : fields) {
      if (wanted == field.name) return field;
    }
    throw ArgumentError("name: this backbone has no setting '" + std::string(wanted.substr(0, 100)) + "'");
  }

  std::unique_ptr<splatboost::BoostSettings> settings;
  std::vector<splatboost::BoostSettings::Setting> fields;  ///< point into *settings
};

struct sb_adapter {
  sb_adapter(const sb_boost& boost, std::uint64_t seed, const sb_device* device) : place(device) {
    boost.settings->validate();
    const Place::Call call(place, device != nullptr ? device->stream : nullptr);
    adapter = boost.settings->make_adapter(seed, place.device());
  }

  Place place;
  std::unique_ptr<splatboost::Adapter> adapter;
  std::int64_t grown = 0;      ///< number of primitives in the last grow
  std::int32_t grown_at = -1;  ///< iteration of the last grow
};

sb_status sb_boost_create(const char* backbone, int32_t literal, sb_boost** boost) {
  return guarded([&] {
    need(boost, "boost") = nullptr;
    SPLATBOOST_CHECK(literal == 0 || literal == 1, "literal must be 0 or 1");
    *boost = new sb_boost(splatboost::find_adapter(&need(backbone, "backbone")), literal == 1);
  });
}

void sb_boost_destroy(sb_boost* boost) { delete boost; }

sb_status sb_boost_setting(const sb_boost* boost, int32_t index, const char** name, int32_t* kind) {
  return guarded([&] {
    const sb_boost& b = need(boost, "boost");
    need(name, "name") = nullptr;
    SPLATBOOST_CHECK(index >= 0, "index must not be negative");
    if (static_cast<std::size_t>(index) >= b.fields.size()) return;
    const auto& field = b.fields[static_cast<std::size_t>(index)];
    *name = field.name;
    if (kind == nullptr) return;
    *kind = std::visit(
        [](auto* value) {
          using T = std::remove_pointer_t<decltype(value)>;
          return std::is_same_v<T, bool>  ? SB_SETTING_BOOL
                 : std::is_same_v<T, int> ? SB_SETTING_INTEGER
                                          : SB_SETTING_REAL;
        },
        field.value);
  });
}

sb_status sb_boost_get(const sb_boost* boost, const char* name, double* value) {
  return guarded([&] {
    const auto& field = need(boost, "boost").find(name);
    need(value, "value") = std::visit([](auto* v) { return static_cast<double>(*v); }, field.value);
  });
}

sb_status sb_boost_set(sb_boost* boost, const char* name, double value) {
  return guarded([&] {
    const auto& field = need(boost, "boost").find(name);
    const std::string setting = field.name;
    SPLATBOOST_CHECK(std::isfinite(value), setting + " must be finite");
    std::visit(
        [&](auto* v) {
          using T = std::remove_pointer_t<decltype(v)>;
          if constexpr (std::is_same_v<T, bool>) {
            SPLATBOOST_CHECK(value == 0 || value == 1, setting + " must be 0 or 1");
            // It also selects the other settings' values.
            SPLATBOOST_CHECK(setting != "literal" || (value != 0) == *v, "literal is an argument of sb_boost_create");
          } else if constexpr (std::is_same_v<T, int>) {
            SPLATBOOST_CHECK(value == std::floor(value) && value >= std::numeric_limits<int>::min() &&
                                 value <= std::numeric_limits<int>::max(),
                             setting + " must be a whole number of 32 bits");
          }
          *v = static_cast<T>(value);
        },
        field.value);
  });
}

sb_status sb_adapter_create(const sb_boost* boost, uint64_t seed, const sb_device* device, sb_adapter** adapter) {
  return guarded([&] {
    need(adapter, "adapter") = nullptr;
    *adapter = new sb_adapter(need(boost, "boost"), seed, device);
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

sb_status sb_adapter_rate_factor(const sb_adapter* adapter, const char* group, int32_t iteration, int32_t total,
                                 float* factor) {
  return guarded([&] {
    const sb_adapter& a = need(adapter, "adapter");
    const std::string_view name = &need(group, "group");
    need(factor, "factor") = a.adapter->rate_factor(name, moment_of(iteration, total));
  });
}

sb_status sb_adapter_averages_at(const sb_adapter* adapter, int32_t iteration, int32_t total, int32_t* averages) {
  return guarded([&] {
    const sb_adapter& a = need(adapter, "adapter");
    need(averages, "averages") = a.adapter->averages_at(moment_of(iteration, total)) ? 1 : 0;
  });
}

sb_status sb_adapter_prunes_large_at(const sb_adapter* adapter, int32_t iteration, int32_t total, int32_t host_would,
                                     int32_t* prunes) {
  return guarded([&] {
    const sb_adapter& a = need(adapter, "adapter");
    need(prunes, "prunes") = a.adapter->prunes_large_at(moment_of(iteration, total), host_would != 0) ? 1 : 0;
  });
}

sb_status sb_adapter_resets_opacities_at(const sb_adapter* adapter, int32_t iteration, int32_t total,
                                         int32_t host_would, int32_t* resets) {
  return guarded([&] {
    const sb_adapter& a = need(adapter, "adapter");
    need(resets, "resets") = a.adapter->resets_opacities_at(moment_of(iteration, total), host_would != 0) ? 1 : 0;
  });
}

sb_status sb_adapter_grow(sb_adapter* adapter, const sb_density* density, const sb_views* views, const sb_tensor* clone,
                          const sb_tensor* split, void* stream) {
  return guarded([&] {
    sb_adapter& a = need(adapter, "adapter");
    const Place::Call call(a.place, stream);
    const splatboost::Device device = a.place.device();
    const sb_density& d = need(density, "density");
    HostRenderer renderer(need(views, "views"), a.place, a.adapter->needs_weights());
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
    if (a.adapter->needs_absolute_gradients()) {
      statistics.gradients_abs = gradients_abs.emplace(values(d.gradients_abs, "gradients_abs")).span();
      statistics.max_scales = max_scales.emplace(values(d.max_scales, "max_scales")).span();
    }
    OnHost clones(a.place.view<std::uint8_t>(clone, "clone", {n}), device);
    OnHost splits(a.place.view<std::uint8_t>(split, "split", {n}), device);
    statistics.max_primitives = cap_of(d);
    std::vector<float> priorities(statistics.gradients.begin(), statistics.gradients.end());
    splatboost::GrowDecisions decisions{clones.span(), splits.span(), priorities};
    a.grown_at = -1;
    a.adapter->grow(statistics, renderer, decisions);
    if (d.max_primitives > 0) {
      for (const float v : priorities) SPLATBOOST_CHECK(!std::isnan(v), "gradients must not be NaN if there is a cap");
      const auto room = static_cast<std::size_t>(std::max<std::int64_t>(0, d.max_primitives - n));
      splatboost::hold_cap(priorities, room, clones.span(), splits.span());
    }
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
    statistics.max_primitives = cap_of(d);
    const std::int64_t n = size_of(remove, "remove");
    SPLATBOOST_CHECK(n < (std::int64_t{1} << 31), "remove: at most 2^31 rows");
    HostRenderer renderer(need(views, "views"), a.place, a.adapter->needs_weights());
    splatboost::PruneDecisions decisions;
    OnHost removals(a.place.view<std::uint8_t>(remove, "remove", {n}), device);
    decisions.remove = removals.span();
    std::vector<std::uint32_t> parents;
    std::optional<OnHost<const float>> opacities;
    if (d.opacities != nullptr) {
      opacities.emplace(a.place.view<const float>(d.opacities, "opacities", {{n}, {n, 1}}), device);
      statistics.opacities = opacities->span();
    }
    std::optional<OnHost<const float>> clearances;
    if (d.clearances != nullptr && a.adapter->needs_clearances()) {
      clearances.emplace(a.place.view<const float>(d.clearances, "clearances", {{n}, {n, 1}}), device);
      statistics.clearances = clearances->span();
    }
    if (origins != nullptr) {
      SPLATBOOST_CHECK(a.grown_at == d.iteration, "origins need a preceding grow at the same iteration");
      OnHost from(a.place.view<const std::int32_t>(origins, "origins", {n}), device);
      for (const std::int32_t origin : from.span()) {
        SPLATBOOST_CHECK(origin >= 0 && origin < a.grown, "origins must be indices of the primitives of the last grow");
        parents.push_back(static_cast<std::uint32_t>(origin));
      }
      decisions.rule = splatboost::PruneRule::growth;
      decisions.origins = parents;
    } else {
      SPLATBOOST_CHECK(views->primitives == n, "views.primitives must be the number of rows of remove");
    }
    a.adapter->prune(statistics, renderer, decisions);
    removals.write_back();
  });
}
