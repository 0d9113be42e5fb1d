// SPDX-License-Identifier: Apache-2.0
#include "splatboost/boost.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <limits>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include <opencv2/core.hpp>

#include "c/adapters_c.h"
#include "include/gaussian_model.h"
#include "include/gaussian_renderer.h"
#include "include/gaussian_scene.h"
#include "splatboost/c_api.h"
#include "splatboost/drawing.h"
#include "splatboost/tensors.h"

namespace splatboost {
namespace {

constexpr int kSplitChildren = 2;
constexpr int kPublishedIterations = 30000;  // length of the schedule that the adapter's numbers refer to
constexpr double kThreshold = 0.9;           // threshold of signed gradients / the host's
constexpr double kAbsoluteThreshold = 2.7;   // threshold of absolute gradients / the host's
constexpr int kProtectedIterations = 100;    // as in the in-tree photo-slam
constexpr const char* kGroups[] = {"xyz", "f_dc", "f_rest", "opacity", "scaling", "rotation"};  // in the host's order
constexpr const char* kPrefix = "SplatBoost.";

}  // namespace

struct Boost::Parts {
  Host host;
  sb_adapter* adapter = nullptr;
  std::int32_t total = 0;
  std::int64_t max_gaussians = 0;  // 0: no cap
  int iteration = 1;               ///< of the last step()
  int loop_closed_at = -kProtectedIterations;
  torch::Device device = torch::kCPU;
  Tensor no_color;
  Tensor signed_sum, absolute_sum, seen;  // float [N] since the last growth

  explicit Parts(const Host& given) : host(given) {}
  Parts(const Parts&) = delete;
  Parts& operator=(const Parts&) = delete;
  ~Parts() { sb_adapter_destroy(adapter); }

  GaussianModel& model() const { return *host.gaussians; }
  std::int64_t count() const { return model().xyz_.size(0); }
  Tensor opacities() const { return model().getOpacityActivation().detach().reshape({-1}); }
  Tensor max_scales() const { return std::get<0>(model().getScalingActivation().detach().max(1)); }
  Tensor indices(std::int64_t n) const {
    return torch::arange(n, torch::TensorOptions().dtype(torch::kLong).device(device));
  }

  void restart() {
    const auto zeros = [&] { return torch::zeros({count()}, torch::TensorOptions().device(device)); };
    signed_sum = zeros();
    absolute_sum = zeros();
    seen = zeros();
  }
  /// Extends the statistics with zeros for Gaussians that were appended since.
  void extend() {
    if (!seen.defined() || seen.size(0) > count()) return restart();
    const std::int64_t missing = count() - seen.size(0);
    if (missing == 0) return;
    for (Tensor* sum : {&signed_sum, &absolute_sum, &seen}) {
      *sum = torch::cat({*sum, torch::zeros({missing}, sum->options())});
    }
  }
  /// Not shortly after a loop closure: the views do not agree yet.
  bool may_prune(int iteration) const { return iteration - loop_closed_at >= kProtectedIterations; }
  /// Removes Gaussians, except recently inserted ones, which have a low opacity only because they are new; keeps at
  /// least one.
  /// @param mask bool [N] @return those removed, bool [N]
  Tensor remove(const Tensor& mask, int iteration) {
    const Tensor inserted = model().exist_since_iter_.to(device).reshape({-1});
    const Tensor old = (inserted == 0) | (inserted <= iteration - kProtectedIterations);
    const Given removals((mask & old).to(torch::kByte)), priorities(opacities());
    const sb_device where = device_of(device);
    std::int64_t removed = 0;
    require(sb_spare_one(&where, priorities, removals, &removed));
    Tensor gone = removals.tensor().to(torch::kBool);
    if (removed > 0) model().prunePoints(gone);
    return gone;
  }
};

namespace {

/// The keyframes as views of the library, from the oldest to the newest.
class Views {
 public:
  Views(const Boost::Host& host, Tensor& no_color, const torch::Device& device)
      : host_(host), no_color_(no_color), device_(device) {
    for (const auto& [id, keyframe] : host.scene->keyframes()) keyframes_.push_back(keyframe);
    views_.context = this;
    views_.primitives = host.gaussians->xyz_.size(0);
    views_.views = static_cast<std::int64_t>(keyframes_.size());
    views_.render = [](void* self, std::int64_t view, sb_scored_view* scored) {
      return static_cast<Views*>(self)->guarded([&](Views& me) { me.render(view, *scored); });
    };
    views_.count_flagged = [](void* self, const sb_tensor* flagged, const sb_tensor* counts) {
      return static_cast<Views*>(self)->guarded([&](Views& me) {
        require(sb_rasterizer_count_flagged(me.host_.gaussians->splatboost_->rasterizer(), flagged, counts, nullptr));
      });
    };
    views_.add_weights = [](void* self, const sb_tensor* weights) {
      return static_cast<Views*>(self)->guarded([&](Views& me) {
        require(sb_rasterizer_add_weights(me.host_.gaussians->splatboost_->rasterizer(), weights, nullptr));
      });
    };
  }

  const sb_views* c_views() const { return &views_; }
  /// Rethrows an exception of a callback; otherwise throws the library's error, if any.
  void check(sb_status status) {
    if (error_) std::rethrow_exception(error_);
    require(status);
  }

 private:
  template <class Do>
  std::int32_t guarded(Do&& act) {
    try {
      act(*this);
      return 0;
    } catch (...) {  // exceptions must not propagate through C
      error_ = std::current_exception();
      return 1;
    }
  }

  /// Renders at full size with the loss's mask of undistorted pixels. Does not count as a use of the keyframe.
  void render(std::int64_t view, sb_scored_view& scored) {
    torch::NoGradGuard no_grad;
    const std::shared_ptr<GaussianKeyframe>& keyframe = keyframes_.at(static_cast<std::size_t>(view));
    const Tensor image =
        std::get<0>(GaussianRenderer::render(keyframe, keyframe->image_height_, keyframe->image_width_, host_.gaussians,
                                             host_.pipeline, host_.background, no_color_));
    const Tensor truth = keyframe->original_image_.to(device_).clamp(0, 1).mul(255).round().to(torch::kByte);
    color_ = Given(image);
    truth_ = Given(truth);
    valid_ = Given();
    const auto mask = host_.masks.find(keyframe->camera_id_);
    if (mask != host_.masks.end()) {
      const Tensor counts = mask->second.dim() == 3 ? mask->second.select(0, 0) : mask->second;
      valid_ = Given((counts.to(device_) > 0.5).to(torch::kByte));
    }
    scored.color = color_;
    scored.truth.color = truth_;
    scored.truth.valid = valid_;
  }

  const Boost::Host& host_;
  Tensor& no_color_;
  torch::Device device_;
  std::vector<std::shared_ptr<GaussianKeyframe>> keyframes_;
  sb_views views_{};
  Given color_, truth_, valid_;
  std::exception_ptr error_;
};

/// The adapter's settings; needed until the adapter is created.
class Settings {
 public:
  explicit Settings(bool literal) { require(sb_boost_create("photo-slam", literal, &boost_)); }
  Settings(const Settings&) = delete;
  Settings& operator=(const Settings&) = delete;
  ~Settings() { sb_boost_destroy(boost_); }

  void set(const std::string& name, double value) { require(sb_boost_set(boost_, name.c_str(), value)); }
  double get(const std::string& name) const {
    double value = 0;
    require(sb_boost_get(boost_, name.c_str(), &value));
    return value;
  }
  sb_boost* boost() const { return boost_; }

 private:
  sb_boost* boost_ = nullptr;
};

/// Reports an invalid user setting: prints one line and exits with status 2 (the host exits with 1 for a missing file),
/// without unwinding, because the host's other threads are running.
[[noreturn]] void refuse(const std::string& line) {
  std::cout.flush();
  std::cerr << line << std::endl;
  std::_Exit(2);
}

/// The keys SplatBoost.… of a settings file, without the prefix.
std::map<std::string, double> read_keys(const std::filesystem::path& path) {
  const cv::FileStorage file(path.string(), cv::FileStorage::READ);
  if (!file.isOpened()) refuse("SplatBoost: " + path.string() + " cannot be read");
  std::map<std::string, double> keys;
  for (const cv::FileNode node : file.root()) {
    const std::string name = node.name();
    if (name.rfind(kPrefix, 0) != 0) continue;
    if (!node.isInt() && !node.isReal()) refuse(path.string() + ": " + name + ": a number wanted");
    keys[name.substr(std::string(kPrefix).size())] = node.real();
  }
  return keys;
}

/// Removes an integer in 0..most from `keys` and returns it; `otherwise` if the key is missing.
std::int64_t take(std::map<std::string, double>& keys, const std::string& name, std::int64_t most,
                  std::int64_t otherwise, const std::filesystem::path& path) {
  const auto found = keys.find(name);
  if (found == keys.end()) return otherwise;
  const double value = found->second;
  keys.erase(found);
  if (!(value >= 0 && value <= static_cast<double>(most) && value == std::floor(value))) {
    refuse(path.string() + ": " + kPrefix + name + ": a whole number in 0 to " + std::to_string(most) + " wanted");
  }
  return static_cast<std::int64_t>(value);
}

}  // namespace

Boost::Boost(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}
Boost::~Boost() = default;

std::shared_ptr<Boost> Boost::make(const std::filesystem::path& path, const Host& host) {
  if (sb_abi_version() != SB_ABI_VERSION) {
    throw std::runtime_error("SplatBoost: the library and its headers are of two versions: build anew");
  }
  std::map<std::string, double> keys = read_keys(path);
  if (take(keys, "on", 1, 1, path) == 0) return nullptr;

  auto parts = std::make_unique<Parts>(host);
  const GaussianOptimizationParams& optimization = host.optimization;
  parts->total = optimization.iterations_;
  parts->device = host.background.device();
  parts->no_color = torch::empty(0, torch::TensorOptions().device(parts->device));
  parts->max_gaussians = take(keys, "max_gaussians", std::numeric_limits<std::int32_t>::max(), 0, path);

  // Settings that the host has too are taken from the host unless the rules are literal, others from the adapter; keys
  // in the file override both.
  const bool literal = take(keys, "literal", 1, 0, path) != 0;
  Settings settings(literal);
  const auto published = [&](int iteration) {
    return std::round(static_cast<double>(iteration) * kPublishedIterations / std::max(1, optimization.iterations_));
  };
  settings.set("lambda_dssim", optimization.lambda_dssim_);
  if (!literal) {  // the literal rules are the paper's, with its thresholds and its plan
    settings.set("gradient_threshold", kThreshold * optimization.densify_grad_threshold_);
    settings.set("gradient_abs_threshold", kAbsoluteThreshold * optimization.densify_grad_threshold_);
    settings.set("percent_dense", optimization.percent_dense_);
    const int interval = optimization.densification_interval_, from = optimization.densify_from_iter_;
    if (interval > 0) settings.set("densify_interval", interval);
    if (from > 0) settings.set("densify_from", published(from));
    settings.set("densify_until", published(optimization.densify_until_iter_));
  }
  if (!host.online) settings.set("recent_share", 0);  // all views are available from the first iteration on
  for (const auto& [name, value] : keys) {
    if (sb_boost_set(settings.boost(), name.c_str(), value) != SB_OK) {
      refuse(path.string() + ": " + kPrefix + name + ": " + sb_last_error());
    }
  }
  const sb_device device = device_of(parts->device);
  if (sb_adapter_create(settings.boost(), 0, &device, &parts->adapter) != SB_OK) {
    refuse(path.string() + ": " + kPrefix + "…: " + sb_last_error());
  }

  float beta = 0;
  require(sb_adapter_beta(parts->adapter, &beta));
  parts->model().splatboost_ = std::make_shared<Drawing>(beta);
  std::cout << "SplatBoost: " << (literal ? "literal" : "default") << " rules of photo-slam, "
            << (beta > 0 ? "beta " + std::to_string(beta) : std::string("published box")) << ", tau_d "
            << settings.get("tau_d") << ", " << parts->total << " iterations" << std::endl;
  return std::shared_ptr<Boost>(new Boost(std::move(parts)));
}

void Boost::gather(const Tensor& screen, const Tensor& seen) {
  Parts& p = *parts_;
  p.extend();
  const Tensor mask = seen.to(torch::kFloat);
  p.seen += mask;
  p.signed_sum += screen.grad().slice(1, 0, 2).norm(2, 1) * mask;
  p.absolute_sum += p.model().splatboost_->absolute_gradients.norm(2, 1) * mask;
}

bool Boost::grows(int iteration, int interval) const {
  std::int32_t grows = 0;
  const bool host_would = interval > 0 && iteration % interval == 0;
  require(sb_adapter_grows_at(parts_->adapter, iteration, parts_->total, host_would, &grows));
  return grows != 0;
}

void Boost::densifyAndPrune(int iteration, float min_opacity, float extent, int max_screen_size) {
  Parts& p = *parts_;
  GaussianModel& g = p.model();
  torch::NoGradGuard no_grad;
  applyGradients();
  p.extend();
  const std::int64_t n = p.count();
  const Tensor views_of = p.seen.clamp_min(1);
  const Given signed_gradients(p.signed_sum / views_of), absolute(p.absolute_sum / views_of);
  const Given scales(p.max_scales());
  const auto none = [&] { return torch::zeros({n}, torch::TensorOptions().dtype(torch::kByte).device(p.device)); };
  // The host's own decisions, used by an adapter without absolute gradients.
  const float border = g.percentDense() * extent;
  const Tensor large = scales.tensor() > border;
  const Tensor high = signed_gradients.tensor() >= p.host.optimization.densify_grad_threshold_;
  const Given cloned((high & ~large).to(torch::kByte)), split((high & large).to(torch::kByte));
  sb_density density{};
  density.iteration = iteration;
  density.total = p.total;
  density.scene_extent = extent;
  density.gradients = signed_gradients;
  density.gradients_abs = absolute;
  density.max_scales = scales;
  density.max_primitives = p.max_gaussians;
  Views views(p.host, p.no_color, p.device);
  views.check(sb_adapter_grow(p.adapter, &density, views.c_views(), cloned, split, nullptr));
  const Tensor clones = cloned.tensor().to(torch::kBool), splits = split.tensor().to(torch::kBool);

  // The host also tests sizes: infinity makes every Gaussian small, -1 makes it large, so that only the masks decide.
  const auto check_count = [&](const Tensor& origins, const char* what) {
    if (p.count() != origins.size(0)) {
      throw std::runtime_error("SplatBoost: " + std::to_string(origins.size(0)) +
                               " Gaussians expected after the host " + what + " some, there are " +
                               std::to_string(p.count()) + ": its densify functions were changed");
    }
  };
  const float percent_dense = g.percentDense();
  const Tensor all = p.indices(n);
  Tensor origins = torch::cat({all, all.index({clones})});
  Tensor chosen = clones.to(torch::kFloat).unsqueeze(1);
  g.setPercentDense(std::numeric_limits<float>::infinity());
  g.densifyAndClone(chosen, 0.5f, 1.0f);
  check_count(origins, "cloned");
  chosen = splits.to(torch::kFloat).unsqueeze(1);
  g.setPercentDense(-1.0f);
  g.densifyAndSplit(chosen, 0.5f, 1.0f, kSplitChildren);
  g.setPercentDense(percent_dense);
  Tensor kept = torch::ones_like(origins, torch::TensorOptions().dtype(torch::kBool));
  kept.slice(0, 0, n).copy_(~splits);
  origins = torch::cat({origins.index({kept}), all.index({splits}).repeat({kSplitChildren})});
  check_count(origins, "split");
  if (!p.may_prune(iteration)) return p.restart();

  Tensor candidates = p.opacities() < min_opacity;
  std::int32_t prunes_large = 0;
  require(sb_adapter_prunes_large_at(p.adapter, iteration, p.total, max_screen_size != 0, &prunes_large));
  if (prunes_large != 0) candidates = candidates | (p.max_scales() > 0.1f * extent);
  const Given removed(candidates.to(torch::kByte)), from(origins.to(torch::kInt)), now(p.opacities());
  sb_density after{};
  after.iteration = iteration;
  after.total = p.total;
  after.scene_extent = extent;
  after.opacities = now;
  Views views_after(p.host, p.no_color, p.device);
  views_after.check(sb_adapter_prune(p.adapter, &after, views_after.c_views(), removed, from, nullptr));
  p.remove(removed.tensor().to(torch::kBool), iteration);
  p.restart();
}

void Boost::pruneLate(int iteration) {
  Parts& p = *parts_;
  if (!p.may_prune(iteration)) return;  // the adapter prunes at the next iteration that asks it
  std::int32_t prunes = 0;
  require(sb_adapter_prunes_at(p.adapter, iteration, p.total, 0, &prunes));
  if (prunes == 0) return;
  torch::NoGradGuard no_grad;
  applyGradients();
  p.extend();
  const Given removed(torch::zeros({p.count()}, torch::TensorOptions().dtype(torch::kByte).device(p.device)));
  const Given opacities(p.opacities());
  sb_density density{};
  density.iteration = iteration;
  density.total = p.total;
  density.opacities = opacities;
  density.max_primitives = p.max_gaussians;
  Views views(p.host, p.no_color, p.device);
  views.check(sb_adapter_prune(p.adapter, &density, views.c_views(), removed, nullptr, nullptr));
  const Tensor gone = p.remove(removed.tensor().to(torch::kBool), iteration);
  for (Tensor* sum : {&p.signed_sum, &p.absolute_sum, &p.seen}) *sum = sum->index({~gone});
}

bool Boost::resets(int iteration) {
  std::int32_t resets = 0;
  require(sb_adapter_resets_opacities_at(parts_->adapter, iteration, parts_->total, 1, &resets));
  if (resets != 0) applyGradients();
  return resets != 0;
}

void Boost::step(int iteration) {
  parts_->iteration = iteration;
  auto& groups = parts_->model().optimizer_->param_groups();
  std::vector<std::pair<Tensor, Tensor>> waiting;
  for (std::size_t i = 0; i < groups.size(); ++i) {
    std::int32_t steps = 1;
    // The host takes its last step one iteration before its last; there every group must step.
    if (iteration < parts_->total - 1) {
      require(sb_adapter_steps_at(parts_->adapter, kGroups[i], iteration, parts_->total, &steps));
    }
    for (Tensor& parameter : groups[i].params()) {
      if (steps == 0 && parameter.grad().defined()) {
        waiting.emplace_back(parameter, parameter.grad());
        parameter.mutable_grad() = Tensor();
      }
    }
  }
  applyGradients();
  for (auto& [parameter, gradient] : waiting) parameter.mutable_grad() = gradient;
}

void Boost::applyGradients() {
  torch::optim::Adam* optimizer = parts_->model().optimizer_.get();
  if (optimizer == nullptr) return;
  auto& groups = optimizer->param_groups();
  std::vector<double> rates;
  for (std::size_t i = 0; i < groups.size(); ++i) {
    float factor = 1;
    require(sb_adapter_rate_factor(parts_->adapter, kGroups[i], parts_->iteration, parts_->total, &factor));
    rates.push_back(groups[i].options().get_lr());
    groups[i].options().set_lr(rates.back() * factor);
  }
  optimizer->step();
  for (std::size_t i = 0; i < groups.size(); ++i) {
    groups[i].options().set_lr(rates[i]);
    for (Tensor& parameter : groups[i].params()) parameter.mutable_grad() = Tensor();
  }
}

void Boost::loopClosed(int iteration) {
  parts_->loop_closed_at = iteration;
  parts_->restart();
}

void densifyAndPrune(const std::shared_ptr<Boost>& boost, const std::shared_ptr<GaussianModel>& gaussians,
                     int iteration, float max_grad, float min_opacity, float extent, int max_screen_size) {
  if (boost) {
    boost->densifyAndPrune(iteration, min_opacity, extent, max_screen_size);
  } else {
    gaussians->densifyAndPrune(max_grad, min_opacity, extent, max_screen_size);
  }
}

const std::shared_ptr<GaussianModel>& settled(const std::shared_ptr<Boost>& boost,
                                              const std::shared_ptr<GaussianModel>& gaussians) {
  if (boost) boost->applyGradients();
  return gaussians;
}

}  // namespace splatboost
