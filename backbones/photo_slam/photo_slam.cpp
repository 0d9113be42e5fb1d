// SPDX-License-Identifier: Apache-2.0
#include "photo_slam/photo_slam.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "families/gaussians/gaussian_backbone.h"
#include "photo_slam/keyframe_schedule.h"
#include "trainer/backbone_api/backbone_entry.h"
#include "trainer/backbone_api/online_backbone.h"
#include "trainer/dataset/smaller_view.h"

namespace splatboost {
namespace {

constexpr int kSmallestSide = 11;  ///< px, minimum size of a pyramid level: the SSIM window

bool sees(const Camera& camera, const glm::vec3& point) {
  const glm::vec3 p = glm::vec3(camera.camera_from_world * glm::vec4(point, 1));
  if (p.z <= 0) return false;
  const float x = camera.fx * p.x / p.z + camera.cx, y = camera.fy * p.y / p.z + camera.cy;
  return x >= 0 && y >= 0 && x < static_cast<float>(camera.width) && y < static_cast<float>(camera.height);
}

Similarity similarity_of(const glm::dmat4& transform) {
  const glm::dmat3 linear(transform);
  const double scale = std::cbrt(glm::determinant(linear));
  return {linear / scale, glm::dvec3(transform[3]), scale};
}

glm::dvec3 moved(const Similarity& by, const glm::dvec3& point) {
  return by.scale * (by.rotation * point) + by.translation;
}

/// Composition: first `first`, then `second`.
Similarity after(const Similarity& second, const Similarity& first) {
  return {second.rotation * first.rotation, moved(second, first.translation), second.scale * first.scale};
}

/// Appends `more` to `points`.
void append(SeenPoints& points, const SeenPoints& more) {
  points.points.positions.insert(points.points.positions.end(), more.points.positions.begin(),
                                 more.points.positions.end());
  points.points.colors.insert(points.points.colors.end(), more.points.colors.begin(), more.points.colors.end());
  points.views.insert(points.views.end(), more.views.begin(), more.views.end());
}

class PhotoSlam final : public GaussianMethod {
 public:
  PhotoSlam(const BackboneContext& context, const PhotoSlamConfig& config)
      : scene_(context.scene),
        config_(config),
        given_iterations_(context.iterations),
        schedule_(config.keyframe_uses, config.pyramid_levels, config.level_uses, context.seed),
        origins_("origin", 2, context.device, [](int) { return 0.0; }) {
    origins_.in_model = false;
  }

  std::string_view name() const override { return "photo-slam"; }
  nlohmann::json config() const override { return to_json(config_); }
  LossForm loss() const override { return {static_cast<float>(config_.lambda_dssim), 1}; }
  std::vector<TrainedGroup*> groups() override { return {&origins_}; }

  /// Initial Gaussians get insertion iteration 0 and the first view that sees them.
  void start(std::span<const float> means) override {
    std::vector<float> rows;
    for (std::size_t i = 0; i < means.size(); i += 3) {
      const glm::vec3 mean(means[i], means[i + 1], means[i + 2]);
      const auto view = std::ranges::find_if(scene_.train, [&](const View& v) { return sees(v.camera, mean); });
      const auto number = view == scene_.train.end() ? 0 : view - scene_.train.begin();
      rows.insert(rows.end(), {0.0f, static_cast<float>(number)});
    }
    origins_.assign(std::move(rows));
  }

  void edit(GaussianSet& set, int iteration) override {
    if (!corrections_.empty()) correct(set, iteration);
    insert(set, iteration, due_);
    if (std::exchange(features_due_, false)) insert(set, iteration, features_);
  }

  /// Not shortly after a loop: the views do not agree yet.
  bool may_prune(Moment moment) const override {
    return !loop_closed_at_ || moment.iteration - *loop_closed_at_ >= config_.protected_iterations;
  }

  void spare(Moment moment, PruneRule, std::span<std::uint8_t> remove) override {
    if (!online_) return;
    std::vector<float> copy;
    const std::span<const float> rows = origins_.values.on_host(copy);
    for (std::size_t i = 0; i < remove.size(); ++i) {
      const int inserted_at = static_cast<int>(rows[2 * i]);
      if (inserted_at > 0 && moment.iteration - inserted_at < config_.protected_iterations) remove[i] = 0;
    }
  }

  /// While views arrive, less than half of the planned run is over, so phases of its second half do not start.
  int planned_iterations(int iteration, int given) const override {
    if (!online_) return given;
    return complete_iterations_ ? *complete_iterations_ : std::max(given_iterations_, 2 * (iteration + 1));
  }
  Moment position_rate_moment(Moment run) const override {
    if (!online_) return run;
    return {std::min(schedule_.used(chosen_), config_.position_steps), config_.position_steps};
  }

  void map_changed(const MapChange& change) {
    online_ = true;
    const std::size_t known = schedule_.size();
    while (schedule_.size() < scene_.train.size()) schedule_.add();
    pyramids_.resize(schedule_.size());
    if (!change.corrections.empty()) {
      std::vector<Similarity> moves;
      for (const glm::dmat4& correction : change.corrections) moves.push_back(similarity_of(correction));
      for (std::size_t i = 0; i < std::min(known, moves.size()); ++i) schedule_.add_uses(i, config_.loop_uses);
      // Correct points that wait for insertion too; points of this change are already corrected.
      move_waiting(due_, moves);
      move_waiting(features_, moves);
      for (std::size_t i = 0; i < std::min(corrections_.size(), moves.size()); ++i) {
        moves[i] = after(moves[i], corrections_[i]);
      }
      corrections_ = std::move(moves);
    }
    append(due_, change.map_points);
    append(features_, change.features);
    // Views present at the start do not count towards the feature cache.
    if (known > 0) cached_ += schedule_.size() - known;
    if (cached_ >= static_cast<std::size_t>(config_.feature_cache)) release_features();
  }

  const View& next_view(int iteration) {
    const KeyframeSchedule::Choice choice = schedule_.next(iteration);
    chosen_ = choice.keyframe;
    const View& full = scene_.train[chosen_];
    std::vector<View>& levels = pyramids_[chosen_];
    const View* view = &full;
    for (int level = 1; level <= choice.level; ++level) {
      if (std::min(view->camera.width, view->camera.height) < 2 * kSmallestSide) break;
      if (levels.size() < static_cast<std::size_t>(level)) levels.push_back(smaller_view(*view, 2));
      view = &levels[static_cast<std::size_t>(level - 1)];
    }
    if (view == &full) {
      levels = {};  // no longer needed
      return full;
    }
    // The pose may have changed since the level was made.
    levels[static_cast<std::size_t>(view - levels.data())].camera.camera_from_world = full.camera.camera_from_world;
    return *view;
  }

  void views_complete(int iterations) {
    complete_iterations_ = iterations;
    release_features();
  }
  int planned(int iteration) const { return planned_iterations(iteration, given_iterations_); }

 private:
  void release_features() {
    features_due_ = true;
    cached_ = 0;
  }

  static void move_waiting(SeenPoints& points, const std::vector<Similarity>& moves) {
    for (std::size_t i = 0; i < points.views.size(); ++i) {
      if (points.views[i] >= moves.size()) continue;
      float* p = &points.points.positions[3 * i];
      const glm::dvec3 place = moved(moves[points.views[i]], {p[0], p[1], p[2]});
      for (int c = 0; c < 3; ++c) p[c] = static_cast<float>(place[c]);
    }
  }

  void insert(GaussianSet& set, int iteration, SeenPoints& points) {
    if (points.points.size() == 0) return;
    const std::size_t first = set.size();
    const std::vector<std::uint32_t> taken = set.insert(points.points);
    origins_.values.edit(2 * first, [&](std::span<float> rows) {
      for (std::size_t i = 0; i < taken.size(); ++i) {
        rows[2 * i] = static_cast<float>(iteration);
        rows[2 * i + 1] = static_cast<float>(points.views[taken[i]]);
      }
    });
    points = {};
  }

  void correct(GaussianSet& set, int iteration) {
    std::vector<float> copy;
    const std::span<const float> rows = origins_.values.on_host(copy);
    std::vector<std::int32_t> which(set.size());
    for (std::size_t i = 0; i < which.size(); ++i) {
      const auto view = static_cast<std::int32_t>(rows[2 * i + 1]);
      which[i] = static_cast<std::size_t>(view) < corrections_.size() ? view : -1;
    }
    set.transform(which, corrections_);
    corrections_.clear();
    loop_closed_at_ = iteration;
  }

  const Scene& scene_;
  PhotoSlamConfig config_;
  int given_iterations_;
  bool online_ = false;
  std::optional<int> complete_iterations_;
  KeyframeSchedule schedule_;
  std::vector<std::vector<View>> pyramids_;  ///< [views] levels from half size down, created on first use
  std::size_t chosen_ = 0;
  TrainedGroup origins_;  ///< [N,2] iteration of insertion (0: initial) and index of the view; not trained
  SeenPoints due_, features_;
  std::size_t cached_ = 0;  ///< number of views whose features wait
  bool features_due_ = false;
  std::vector<Similarity> corrections_;
  std::optional<int> loop_closed_at_;
};

/// The trainer of explicit Gaussians, extended by OnlineBackbone.
class PhotoSlamBackbone final : public Backbone, public OnlineBackbone {
 public:
  PhotoSlamBackbone(const BackboneContext& context, const PhotoSlamConfig& config) {
    auto method = std::make_unique<PhotoSlam>(context, config);
    method_ = method.get();
    gaussians_ = make_gaussian_backbone(context, config, std::move(method));
  }

  double train_step(int iteration, const View& view) override { return gaussians_->train_step(iteration, view); }
  void wait() override { gaussians_->wait(); }
  void finish() override { gaussians_->finish(); }
  std::size_t primitives() const override { return gaussians_->primitives(); }
  std::size_t bytes_per_primitive() const override { return gaussians_->bytes_per_primitive(); }
  std::size_t bytes_per_pixel() const override { return gaussians_->bytes_per_pixel(); }
  void render(const Camera& camera, float time, std::optional<float> beta, std::span<float> color) override {
    gaussians_->render(camera, time, beta, color);
  }
  bool has_surfaces() const override { return gaussians_->has_surfaces(); }
  void render_surface(const Camera& camera, float time, std::optional<float> beta,
                      const SurfaceImages& images) override {
    gaussians_->render_surface(camera, time, beta, images);
  }
  std::uint64_t export_model(const std::filesystem::path& folder) const override {
    return gaussians_->export_model(folder);
  }
  void import_model(const std::filesystem::path& folder) override { gaussians_->import_model(folder); }
  void save(ArchiveWriter& archive) const override { gaussians_->save(archive); }
  void load(ArchiveReader& archive) override { gaussians_->load(archive); }
  nlohmann::json config() const override { return gaussians_->config(); }
  RasterizerHook& rasterizer_hook() override { return gaussians_->rasterizer_hook(); }
  void set_hooks(DensityHook* density, OptimizerHook* optimizer) override { gaussians_->set_hooks(density, optimizer); }
  const StageClock& stages() const override { return gaussians_->stages(); }

  void map_changed(const MapChange& change) override { method_->map_changed(change); }
  const View& next_view(int iteration) override { return method_->next_view(iteration); }
  void views_complete(int iterations) override { method_->views_complete(iterations); }
  int planned_iterations(int iteration) const override { return method_->planned(iteration); }

 private:
  PhotoSlam* method_ = nullptr;  ///< owned by gaussians_
  std::unique_ptr<Backbone> gaussians_;
};

}  // namespace

std::unique_ptr<Backbone> make_photo_slam(const BackboneContext& context, const PhotoSlamConfig& config) {
  return std::make_unique<PhotoSlamBackbone>(context, config);
}

BackboneEntry photo_slam_entry() {
  return {"photo-slam", kPublishedIterations, [](const BackboneContext& context, const nlohmann::json& constants) {
            return make_photo_slam(context, photo_slam_config_from_json(constants));
          }};
}

}  // namespace splatboost
