// SPDX-License-Identifier: Apache-2.0
#include "octree_gs/octree_gs.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "families/anchors/anchor_backbone.h"
#include "families/anchors/anchor_cells.h"
#include "octree_gs/octree_levels.h"
#include "octree_gs/usable_anchors.h"
#include "trainer/backbone_api/backbone_entry.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr double kFinestSide = 0.02;  // of a cell, to derive base_layer from the box; in units of the settings
constexpr std::size_t kGrain = 1024;

DecoderShape shape_of(const OctreeConfig& config) {
  DecoderShape shape;
  shape.features = static_cast<std::size_t>(config.feat_dim);
  shape.offsets = static_cast<std::size_t>(config.n_offsets);
  shape.appearance = static_cast<std::size_t>(config.appearance_dim);
  shape.opacity_distance = config.add_opacity_dist;
  shape.covariance_distance = config.add_cov_dist;
  shape.color_distance = config.add_color_dist;
  shape.level = config.add_level;
  shape.feature_bank = config.use_feat_bank;
  shape.bank_distance = false;
  return shape;
}

class Octree final : public AnchorBackbone {
 public:
  Octree(const BackboneContext& context, const OctreeConfig& config)
      : AnchorBackbone(context, config, shape_of(config), kOctreeIterations),
        config_(config),
        rounding_(level_rounding_named(config.dist2level)) {
    add_side_row({"level", &level_});
    add_side_row({"extra_level", &extra_level_});
    add_constant({"voxel_size", &voxel_size_});
    add_constant({"standard_dist", &standard_distance_});
    add_constant({"levels", &levels_});
    add_constant({"init_level", &init_level_});
    add_constant({"visible_threshold", &visible_threshold_});
    add_constant({"init_pos", &origin_});
    initialise();
  }

  nlohmann::json config() const override { return to_json(config_); }

 private:
  void initialise();
  std::span<const std::uint8_t> usable_anchors(const Camera& camera) override;
  void anchors_changed() override;
  std::span<const float> levels() const override {
    return config_.add_level ? on_device(level_, level_there_) : std::span<const float>{};
  }
  std::span<const float> on_device(const std::vector<float>& row, const Array<float>& there) const {
    return context().device.is_cuda() ? there.span() : std::span<const float>(row);
  }
  void choose_growing(std::span<const float> gradients, std::span<const std::uint8_t> judged,
                      std::span<std::uint8_t> growing) override;
  void grow(std::span<const float> gradients, std::span<const std::uint8_t> growing) override;

  int level_count() const { return static_cast<int>(levels_); }
  float fork() const { return static_cast<float>(config_.fork); }
  CellGrid grid(int level) const {
    return {voxel_size_ / std::pow(fork(), static_cast<float>(level)), {origin_, origin_, origin_}};
  }
  /// Finest level enabled at this iteration.
  int highest_level() const;
  double threshold(double level) const {
    return config_.gradient_threshold * std::pow(static_cast<double>(config_.fork), config_.update_ratio * level);
  }
  std::vector<float> positions_at(int level) const;
  /// Share of the training cameras that would use an anchor at each position.
  std::vector<float> camera_shares(std::span<const float> positions, int level) const;
  /// Adds anchors at the slots' positions, on the grid of `level`.
  /// @param inherit whether new anchors get the channel-wise maximum of their parents' features, or zeros
  void add_level(int level, bool inherit, std::span<const float> gradients, std::span<const std::uint32_t> slots);

  OctreeConfig config_;
  LevelRounding rounding_;
  std::vector<float> level_, extra_level_;                                            ///< [N]
  Array<float> level_there_{context().device}, extra_level_there_{context().device};  ///< copies on a GPU
  float voxel_size_ = 0, standard_distance_ = 0, levels_ = 0, init_level_ = 0, visible_threshold_ = 0, origin_ = 0;
  Array<std::uint8_t> usable_{context().device};
  int highest_in_use_ = 0;  ///< finest level enabled in the last view
};

void Octree::initialise() {
  const std::vector<float>& points = context().scene.points.positions;
  require(!points.empty(), "the scene has no points to place anchors at; add a point cloud to the dataset");
  const LevelRange range = measure_levels(points, context().scene.train, config_.dist_ratio, config_.fork);
  standard_distance_ = range.standard_distance;
  levels_ = static_cast<float>(config_.levels > 0 ? config_.levels : range.levels);
  require(level_count() <= kMaxLevels, "the distances in the scene require more than " + std::to_string(kMaxLevels) +
                                           " levels; set levels in the backbone config");
  init_level_ = static_cast<float>(config_.init_level >= 0 ? config_.init_level : level_count() / 2);
  const auto [low, high] = std::minmax_element(points.begin(), points.end());
  const auto extend = static_cast<float>(config_.extend);
  origin_ = *low * extend;
  const float side = *high * extend - origin_;
  require(side > 0, "all points of the scene are at the same position");
  const int base =
      config_.base_layer >= 0
          ? config_.base_layer
          : static_cast<int>(std::nearbyint(std::log2(side / (unit() * kFinestSide)))) - level_count() / 2 + 1;
  voxel_size_ = side / std::pow(fork(), static_cast<float>(base));

  const std::vector<float> all = starting_points(context().scene).positions;
  std::vector<std::vector<float>> positions;
  std::vector<std::vector<float>> shares;
  double sum = 0;
  std::size_t count = 0;
  for (int level = 0; level < level_count(); ++level) {
    positions.push_back(occupied_centres(grid(level), all));
    shares.push_back(camera_shares(positions.back(), level));
    for (const float share : shares.back()) sum += share;
    count += shares.back().size();
  }
  require(sum > 0, "no camera of the scene uses any anchor; check dist_ratio and levels in the backbone config");
  visible_threshold_ = config_.visible_threshold >= 0 ? static_cast<float>(config_.visible_threshold)
                                                      : static_cast<float>(sum / static_cast<double>(count));
  std::vector<float> kept;
  for (int level = 0; level < level_count(); ++level) {
    const auto at = static_cast<std::size_t>(level);
    for (std::size_t i = 0; i < shares[at].size(); ++i) {
      if (!(shares[at][i] > visible_threshold_)) continue;
      kept.insert(kept.end(), &positions[at][3 * i], &positions[at][3 * i] + 3);
      level_.push_back(static_cast<float>(level));
    }
  }
  require(!kept.empty(),
          "no anchor is used by a larger share of the cameras than visible_threshold; lower visible_threshold");
  extra_level_.assign(level_.size(), 0.0f);
  set_anchors(kept);
}

int Octree::highest_level() const {
  const int finest = level_count() - 1;
  if (!config_.progressive) return finest;
  const int first = static_cast<int>(init_level_);
  const double end = static_cast<double>(config_.coarse_iter) * context().iterations / kOctreeIterations;
  const std::vector<double> opens = opening_iterations(finest - first, end, config_.coarse_factor);
  const auto opened = std::lower_bound(opens.begin(), opens.end(), static_cast<double>(iteration()));
  return std::min(finest, first + static_cast<int>(opened - opens.begin()));
}

void Octree::anchors_changed() {
  const bool fits = levels_ >= 1 && levels_ <= static_cast<float>(kMaxLevels) &&
                    std::ranges::all_of(level_, [&](float level) { return level >= 0 && level < levels_; });
  require(fits, "the anchor levels of the model are out of range; its files are damaged or from different runs");
  if (!context().device.is_cuda()) return;
  level_there_.assign(level_);
  extra_level_there_.assign(extra_level_);
}

std::span<const std::uint8_t> Octree::usable_anchors(const Camera& camera) {
  const glm::vec3 centre = camera.centre();
  const int highest = highest_level();
  if (std::exchange(highest_in_use_, highest) < highest) forget_views();
  LevelsInUse rule{{centre.x, centre.y, centre.z}, standard_distance_, fork(), rounding_, highest, {}};
  for (int level = 0; level < level_count(); ++level) {
    rule.shift[static_cast<std::size_t>(level)] = 0.5f * grid(level).size;
  }
  usable_.ensure(level_.size());
  splatboost::usable_anchors(rule, positions_on_device(), on_device(level_, level_there_),
                             on_device(extra_level_, extra_level_there_), usable_, context().device);
  return usable_;
}

std::vector<float> Octree::camera_shares(std::span<const float> positions, int level) const {
  std::vector<float> shares(positions.size() / 3);
  std::vector<glm::vec3> centres;
  for (const View& view : context().scene.train) centres.push_back(view.camera.centre());
  context().threads.for_range(shares.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const glm::vec3 p(positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]);
      std::size_t uses = 0;
      for (const glm::vec3& centre : centres) {
        const float wanted = level_at(glm::length(p - centre), standard_distance_, fork());
        uses += level <= whole_level(wanted, rounding_, level_count() - 1) ? 1 : 0;
      }
      shares[i] = static_cast<float>(uses) / static_cast<float>(centres.size());
    }
  });
  return shares;
}

void Octree::choose_growing(std::span<const float> gradients, std::span<const std::uint8_t> judged,
                            std::span<std::uint8_t> growing) {
  for (std::size_t i = 0; i < growing.size(); ++i) {
    const auto level = static_cast<double>(level_[i / slots_per_anchor()]);
    growing[i] = judged[i] != 0 && gradients[i] >= static_cast<float>(threshold(level));
  }
  // Anchors with a large mean gradient get a higher extra level. This is not growth, so density hooks do not affect it.
  const std::size_t k = slots_per_anchor();
  std::vector<std::uint8_t> present(static_cast<std::size_t>(level_count()), 0);
  for (const float level : level_) present[static_cast<std::size_t>(level)] = 1;
  for (std::size_t a = 0; a < level_.size(); ++a) {
    float sum = 0;
    int seen = 0;
    for (std::size_t j = k * a; j < k * (a + 1); ++j) {
      if (judged[j] == 0) continue;
      sum += gradients[j];
      ++seen;
    }
    const float mean = sum / (static_cast<float>(seen) + 1e-6f);
    for (int level = 0; level < level_count(); ++level) {
      // As released: applied once for every level that has anchors, whatever the anchor's own level.
      if (present[static_cast<std::size_t>(level)] == 0) continue;
      if (mean >= static_cast<float>(threshold(level) * config_.extra_ratio)) {
        extra_level_[a] += static_cast<float>(config_.extra_up);
      }
    }
  }
}

void Octree::grow(std::span<const float> gradients, std::span<const std::uint8_t> growing) {
  const std::size_t before = level_.size(), k = slots_per_anchor();
  std::vector<std::uint32_t> same, finer;
  for (int level = 0; level < level_count(); ++level) {
    same.clear();
    finer.clear();
    const auto finer_from = static_cast<float>(threshold(level + 1));
    for (std::size_t a = 0; a < before; ++a) {
      if (static_cast<int>(level_[a]) != level) continue;
      for (std::size_t slot = k * a; slot < k * (a + 1); ++slot) {
        if (growing[slot] == 0) continue;
        (gradients[slot] >= finer_from ? finer : same).push_back(static_cast<std::uint32_t>(slot));
      }
    }
    add_level(level, true, gradients, same);
    // There is no level below the finest one; the release adds nothing then.
    if (level + 1 < level_count()) add_level(level + 1, false, gradients, finer);
  }
}

std::vector<float> Octree::positions_at(int level) const {
  std::vector<float> found;
  const std::span<const float> p = positions();
  for (std::size_t a = 0; a < level_.size(); ++a) {
    if (static_cast<int>(level_[a]) == level) found.insert(found.end(), &p[3 * a], &p[3 * a] + 3);
  }
  return found;
}

void Octree::add_level(int level, bool inherit, std::span<const float> gradients,
                       std::span<const std::uint32_t> slots) {
  const std::vector<float> held = positions_at(level);
  if (slots.empty() || held.empty()) return;  // a level without anchors stays empty, as released
  std::vector<float> points;
  for (const std::uint32_t slot : slots) {
    const std::array<float, 3> p = slot_position(slot);
    points.insert(points.end(), p.begin(), p.end());
  }
  const CellGrid cells = grid(level);
  const NewCells found = new_cells(cells, points, held);
  std::vector<float> centres;
  for (const Cell& cell : found.cells) {
    const std::array<float, 3> centre = cells.centre_of(cell);
    centres.insert(centres.end(), centre.begin(), centre.end());
  }
  const std::vector<float> shares = camera_shares(centres, level);
  std::vector<float> kept, features, importance;
  for (std::size_t c = 0; c < found.cells.size(); ++c) {
    if (!(shares[c] > visible_threshold_)) continue;
    kept.insert(kept.end(), &centres[3 * c], &centres[3 * c] + 3);
    const std::size_t first = features.size();
    features.resize(first + static_cast<std::size_t>(config_.feat_dim), 0.0f);
    float largest = 0;
    for (std::size_t s = 0; s < found.sources[c].size(); ++s) {
      const std::uint32_t slot = slots[found.sources[c][s]];
      largest = std::max(largest, gradients[slot]);
      if (!inherit) continue;
      const std::span<const float> parent = anchor_feature(slot / slots_per_anchor());
      for (std::size_t i = 0; i < parent.size(); ++i) {
        features[first + i] = s == 0 ? parent[i] : std::max(features[first + i], parent[i]);
      }
    }
    importance.push_back(largest);
  }
  const std::size_t added = append_anchors(kept, std::log(cells.size), features, importance);
  std::fill(level_.end() - static_cast<std::ptrdiff_t>(added), level_.end(), static_cast<float>(level));
}

}  // namespace

std::unique_ptr<Backbone> make_octree(const BackboneContext& context, const OctreeConfig& config) {
  return std::make_unique<Octree>(context, config);
}

BackboneEntry octree_gs_entry() {
  return {"octree-gs", kOctreeIterations, [](const BackboneContext& context, const nlohmann::json& constants) {
            return make_octree(context, octree_config_from_json(constants));
          }};
}

}  // namespace splatboost
