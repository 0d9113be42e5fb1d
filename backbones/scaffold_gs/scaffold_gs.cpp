// SPDX-License-Identifier: Apache-2.0
#include "scaffold_gs/scaffold_gs.h"

#include <algorithm>
#include <cmath>

#include "families/anchors/anchor_backbone.h"
#include "families/anchors/anchor_cells.h"
#include "splatboost/neighbors.h"
#include "splatboost/random.h"
#include "trainer/backbone_api/backbone_entry.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr int kPublishedLength = 30000;

DecoderShape shape_of(const ScaffoldConfig& config) {
  DecoderShape shape;
  shape.features = static_cast<std::size_t>(config.feat_dim);
  shape.offsets = static_cast<std::size_t>(config.n_offsets);
  shape.appearance = static_cast<std::size_t>(config.appearance_dim);
  shape.opacity_distance = config.add_opacity_dist;
  shape.covariance_distance = config.add_cov_dist;
  shape.color_distance = config.add_color_dist;
  shape.feature_bank = config.use_feat_bank;
  return shape;
}

class Scaffold final : public AnchorBackbone {
 public:
  Scaffold(const BackboneContext& context, const ScaffoldConfig& config)
      : AnchorBackbone(context, config, shape_of(config), kPublishedLength), config_(config) {
    add_constant({"voxel_size", &voxel_size_});
    initialise();
  }

  nlohmann::json config() const override { return to_json(config_); }

 private:
  void initialise();
  void choose_growing(std::span<const float> gradients, std::span<const std::uint8_t> judged,
                      std::span<std::uint8_t> growing) override;
  void grow(std::span<const float> gradients, std::span<const std::uint8_t> growing) override;
  std::size_t grow_level(std::span<const float> gradients, std::span<const std::uint32_t> slots, float cell_size);

  ScaffoldConfig config_;
  float voxel_size_ = 0;
};

void Scaffold::initialise() {
  const std::vector<float>& points = context().scene.points.positions;
  require(!points.empty(), "the scene has no points to place anchors at; add a point cloud to the dataset");
  voxel_size_ = static_cast<float>(unit() * config_.voxel_size);
  if (voxel_size_ == 0) {
    std::vector<float> squared(points.size() / 3);
    mean_squared_neighbor_distances(points, 3, squared, context().threads);
    const auto middle = squared.begin() + static_cast<std::ptrdiff_t>((squared.size() - 1) / 2);
    std::nth_element(squared.begin(), middle, squared.end());
    voxel_size_ = *middle;
    require(voxel_size_ > 0, "most points of the scene are duplicates; set voxel_size in the backbone config");
  }
  set_anchors(occupied_centres({voxel_size_, {}}, starting_points(context().scene).positions));
}

void Scaffold::choose_growing(std::span<const float> gradients, std::span<const std::uint8_t> judged,
                              std::span<std::uint8_t> growing) {
  // The threshold of the coarsest level; grow() applies the higher ones of finer levels.
  for (std::size_t i = 0; i < growing.size(); ++i) {
    growing[i] = judged[i] != 0 && gradients[i] >= static_cast<float>(config_.gradient_threshold);
  }
}

void Scaffold::grow(std::span<const float> gradients, std::span<const std::uint8_t> growing) {
  const RandomStream random(context().seed, static_cast<std::uint64_t>(iteration()), RandomPurpose::grow);
  const std::size_t n = growing.size();
  double threshold = config_.gradient_threshold;
  double keep = 0.5;
  int factor = config_.update_init_factor;
  std::size_t added = 0;
  std::vector<std::uint32_t> slots;
  for (int level = 0; level < config_.update_depth; ++level) {
    // Finer levels grow only if a coarser one added anchors.
    if ((level == 0 || added > 0) && factor > 0) {
      slots.clear();
      for (std::size_t i = 0; i < n; ++i) {
        // One random number per (level, slot), so that a density hook does not change the choice among other slots.
        const std::uint64_t number = static_cast<std::uint64_t>(level) * n + i;
        if (growing[i] != 0 && gradients[i] >= static_cast<float>(threshold) && random.uniform(number) > keep) {
          slots.push_back(static_cast<std::uint32_t>(i));
        }
      }
      added += grow_level(gradients, slots, voxel_size_ * static_cast<float>(factor));
    }
    threshold *= 0.5 * config_.update_hierarchy_factor;
    keep *= 0.5;
    factor /= config_.update_hierarchy_factor;
  }
}

std::size_t Scaffold::grow_level(std::span<const float> gradients, std::span<const std::uint32_t> slots,
                                 float cell_size) {
  std::vector<float> points;
  for (const std::uint32_t slot : slots) {
    const std::array<float, 3> p = slot_position(slot);
    points.insert(points.end(), p.begin(), p.end());
  }
  const CellGrid grid{cell_size, {}};
  const NewCells found = new_cells(grid, points, positions());
  std::vector<float> centres, features, importance;
  for (std::size_t c = 0; c < found.cells.size(); ++c) {
    const std::array<float, 3> centre = grid.centre_of(found.cells[c]);
    centres.insert(centres.end(), centre.begin(), centre.end());
    // The new anchor's feature is the channel-wise maximum of its parents' features.
    float largest = 0;
    const std::size_t first = features.size();
    for (const std::uint32_t source : found.sources[c]) {
      const std::uint32_t slot = slots[source];
      largest = std::max(largest, gradients[slot]);
      const std::span<const float> parent = anchor_feature(slot / slots_per_anchor());
      if (features.size() == first) {
        features.insert(features.end(), parent.begin(), parent.end());
      } else {
        for (std::size_t i = 0; i < parent.size(); ++i) features[first + i] = std::max(features[first + i], parent[i]);
      }
    }
    importance.push_back(largest);
  }
  return append_anchors(centres, std::log(cell_size), features, importance);
}

}  // namespace

std::unique_ptr<Backbone> make_scaffold(const BackboneContext& context, const ScaffoldConfig& config) {
  return std::make_unique<Scaffold>(context, config);
}

BackboneEntry scaffold_gs_entry() {
  return {"scaffold-gs", kPublishedIterations, [](const BackboneContext& context, const nlohmann::json& constants) {
            return make_scaffold(context, scaffold_config_from_json(constants));
          }};
}

}  // namespace splatboost
