// SPDX-License-Identifier: Apache-2.0
#include "families/gaussians/gaussian_trainer.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>

#include "splatboost/clearance.h"
#include "splatboost/density_statistics.h"
#include "splatboost/rows.h"
#include "splatboost/select.h"

namespace splatboost {
namespace {

constexpr int kSplitChildren = 2;
constexpr float kSplitShrink = 0.8f * kSplitChildren;

}  // namespace

DensityStatistics GaussianTrainer::statistics() {
  activate();
  const std::size_t n = primitives();
  mean_gradients_.ensure(n);
  mean_gradients_abs_.ensure(n);
  max_scales_.ensure(n);
  mean_screen_gradients(gradient_sums(), mean_gradients_, mean_gradients_abs_, device_);
  longest_scales(scaling_.activated, max_scales_, device_);
  return {moment(),
          context_.scene.extent,
          mean_gradients_.on_host(on_host_.mean_gradients),
          mean_gradients_abs_.on_host(on_host_.mean_gradients_abs),
          opacity_.activated.on_host(on_host_.opacities),
          max_scales_.on_host(on_host_.max_scales),
          {},
          context_.max_primitives};
}

std::span<const float> GaussianTrainer::clearances() {
  if (camera_distances_.empty()) {
    std::vector<float> centres, distances(context_.scene.train.size());
    for (const View& view : context_.scene.train) {
      const glm::vec3 centre = view.camera.centre();
      centres.insert(centres.end(), {centre.x, centre.y, centre.z});
    }
    // Not starting_points(): more of them may be wrong.
    distances_to_scene(centres, context_.scene.points.positions, distances, context_.threads);
    camera_centres_.assign(std::move(centres));
    camera_distances_.assign(std::move(distances));
  }
  clearances_.ensure(primitives());
  camera_clearances(xyz_.values, camera_centres_, camera_distances_, clearances_, device_);
  return clearances_.on_host(on_host_.clearances);
}

void GaussianTrainer::control_density() {
  const int until = at(config_.densify_until);
  const bool own =
      iteration_ < until && iteration_ > at(config_.densify_from) && iteration_ % config_.densify_interval == 0;
  // After densify_until no statistics are gathered, so a hook cannot request growth.
  if (density_ != nullptr ? iteration_ < until && density_->grows_at(moment(), own) : own) {
    step_all();
    grow();
    prune(PruneRule::growth);
    reorder();
    restart_statistics();
  }
  if (method_->trims_at(moment())) {
    step_all();
    prune(PruneRule::trim);
    restart_statistics();
  }
  // May follow growth in the same iteration, if the method grows until the end of the run.
  if (density_ != nullptr && density_->prunes_at(moment(), false)) {
    step_all();
    prune(PruneRule::late);
    restart_statistics();
  }
  const bool white_start =
      context_.scene.white_background && config_.densify_from > 0 && iteration_ == at(config_.densify_from);
  // Where growth lasts to the end (DropGaussian), opacities have the last tenth of the run to recover, as in a run of
  // the published length.
  const bool may_reset = iteration_ < until && 10 * std::int64_t{iteration_} <= 9 * std::int64_t{context_.iterations};
  const bool own_reset = may_reset && (iteration_ % opacity_reset_interval() == 0 || white_start);
  if (density_ != nullptr ? density_->resets_opacities_at(moment(), own_reset) : own_reset) {
    step_all();
    reset_opacities();
  }
}

void GaussianTrainer::grow() {
  const DensityStatistics known = statistics();
  const std::size_t n = primitives();
  std::vector<std::uint8_t> growing(n), clone(n), split(n);
  const std::span<const float> gradients =
      method_->grows_by_absolute_gradients() ? known.gradients_abs : known.gradients;
  const auto threshold = static_cast<float>(config_.gradient_threshold);
  std::vector<float> priorities(n);
  for (std::size_t i = 0; i < n; ++i) {
    growing[i] = gradients[i] >= threshold;
    priorities[i] = growth_priority(gradients[i], threshold);
  }
  method_->add_growing(known, growing, priorities);
  const auto border = static_cast<float>(config_.percent_dense * static_cast<double>(context_.scene.extent));
  for (std::size_t i = 0; i < n; ++i) {
    clone[i] = growing[i] != 0 && known.max_scales[i] <= border;
    split[i] = growing[i] != 0 && known.max_scales[i] > border;
  }
  if (density_ != nullptr) {
    GrowDecisions decisions{clone, split, priorities};
    density_->grow(known, *this, decisions);
  }
  if (context_.max_primitives > 0) {
    // A clone and a split each add one Gaussian.
    hold_cap(priorities, context_.max_primitives - std::min(context_.max_primitives, n), clone, split);
  }

  origins_.resize(n);
  std::iota(origins_.begin(), origins_.end(), 0u);
  std::vector<std::uint32_t> clones, parents;
  for (std::size_t i = 0; i < n; ++i) {
    if (split[i] != 0) {
      parents.push_back(static_cast<std::uint32_t>(i));
    } else if (clone[i] != 0) {
      clones.push_back(static_cast<std::uint32_t>(i));
    }
  }
  forget_averages(groups_);
  // Reserve all groups first: if memory runs out, the model stays intact.
  for (TrainedGroup* group : row_groups_) group->reserve_rows(n + clones.size() + kSplitChildren * parents.size());
  stale_ = set_changed_ = true;  // also if memory runs out below
  const Array<std::uint32_t> listed(device_, clones);
  const std::size_t first_clone = primitives();
  for (TrainedGroup* group : row_groups_) group->append_copies(listed);
  origins_.insert(origins_.end(), clones.begin(), clones.end());
  if (method_->scatters_clones()) {
    Array<float> scales(device_), rotations(device_);
    append_rows_of(scaling_.activated, 3, listed, scales);
    append_rows_of(rotation_.values, 4, listed, rotations);
    const RandomStream random(context_.seed, static_cast<std::uint64_t>(iteration_), RandomPurpose::grow);
    const std::vector<float> offsets = scattered(scales.to_host(), rotations.to_host(), random, 0);
    xyz_.values.edit(3 * first_clone, [&](std::span<float> means) {
      for (std::size_t k = 0; k < means.size(); ++k) means[k] += offsets[k];
    });
  }
  append_children(parents);
  split.resize(primitives(), 0);  // remove parents, keep clones and children
  remove(split);
}

std::vector<float> GaussianTrainer::scattered(std::span<const float> scales, std::span<const float> rotations,
                                              const RandomStream& random, std::uint64_t first_number) {
  std::vector<float> offsets(scales.size());
  for (std::size_t j = 0; j < scales.size() / 3; ++j) {
    // R·(scale ⊙ normal)
    const float* q = &rotations[4 * j];
    const float length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    const float w = q[0] / length, x = q[1] / length, y = q[2] / length, z = q[3] / length;
    const float rotation[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                                  {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                                  {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
    float offset[3];
    for (std::size_t c = 0; c < 3; ++c) {
      const std::uint64_t number = 3 * (first_number + j) + c;
      offset[c] = static_cast<float>(random.normal(number)) * scales[3 * j + c];
    }
    for (std::size_t c = 0; c < 3; ++c) {
      offsets[3 * j + c] = rotation[c][0] * offset[0] + rotation[c][1] * offset[1] + rotation[c][2] * offset[2];
    }
  }
  return offsets;
}

void GaussianTrainer::append_children(std::span<const std::uint32_t> parents) {
  const RandomStream random(context_.seed, static_cast<std::uint64_t>(iteration_), RandomPurpose::split);
  const Array<std::uint32_t> listed(device_, std::vector<std::uint32_t>(parents.begin(), parents.end()));
  Array<float> listed_scales(device_), listed_rotations(device_);
  append_rows_of(scaling_.activated, 3, listed, listed_scales);
  append_rows_of(rotation_.values, 4, listed, listed_rotations);
  const std::vector<float> scales = listed_scales.to_host(), rotations = listed_rotations.to_host();
  for (int child = 0; child < kSplitChildren; ++child) {
    const std::size_t first = primitives();
    for (TrainedGroup* group : row_groups_) group->append_copies(listed);
    origins_.insert(origins_.end(), parents.begin(), parents.end());
    const std::vector<float> offsets =
        scattered(scales, rotations, random, parents.size() * static_cast<std::size_t>(child));
    xyz_.values.edit(3 * first, [&](std::span<float> means) {
      for (std::size_t k = 0; k < means.size(); ++k) means[k] += offsets[k];
    });
    scaling_.values.edit(3 * first, [&](std::span<float> logarithms) {
      for (std::size_t k = 0; k < logarithms.size(); ++k) {
        // The scale of a very flat Gaussian may have underflowed to 0.
        const float scale = std::max(scales[k], std::numeric_limits<float>::min());
        logarithms[k] = std::log(scale / kSplitShrink);
      }
    });
  }
  stale_ = set_changed_ = true;
}

void GaussianTrainer::prune(PruneRule rule) {
  if (rule == PruneRule::growth) {
    restart_statistics();
  } else {
    origins_.clear();
  }
  if (density_ != nullptr && !method_->may_prune(moment())) return;
  DensityStatistics known = statistics();
  if (density_ != nullptr && density_->needs_clearances()) known.clearances = clearances();
  const std::size_t n = primitives();
  std::vector<std::uint8_t> removed(n, 0);
  if (rule == PruneRule::growth) {
    // The released code also tests sizes on screen, but zeroes them in the preceding growth, so that test never passes.
    bool large_go = config_.max_world_scale > 0 && iteration_ > opacity_reset_interval();
    if (density_ != nullptr && config_.max_world_scale > 0) large_go = density_->prunes_large_at(moment(), large_go);
    const auto large = static_cast<float>(config_.max_world_scale * static_cast<double>(context_.scene.extent));
    for (std::size_t i = 0; i < n; ++i) {
      removed[i] =
          known.opacities[i] < static_cast<float>(config_.min_opacity) || (large_go && known.max_scales[i] > large);
    }
  } else if (rule == PruneRule::trim) {
    method_->trim(known, static_cast<ViewDrawer&>(*this), removed);
  }
  if (density_ != nullptr) {
    PruneDecisions decisions{removed, rule, origins_};
    density_->prune(known, *this, decisions);
    method_->spare(moment(), rule, removed);
  }
  if (spare_one(known.opacities, removed) > 0) remove(removed);
}

void GaussianTrainer::reset_opacities() {
  const std::vector<float> factors = copy_to_host(method_->opacity_factors(), device_);
  const float cap = logit(config_.reset_opacity);
  opacity_.values.edit(0, [&](std::span<float> values) {
    for (std::size_t i = 0; i < values.size(); ++i) {
      float& value = values[i];
      if (factors.empty()) {
        value = std::min(value, cap);
      } else if (config_.reset_opacity < static_cast<double>(factors[i])) {
        // The reset limits the rendered opacity; if the factor alone is below the limit, nothing is to be done.
        value = std::min(value, logit(config_.reset_opacity / static_cast<double>(factors[i])));
      }
    }
  });
  opacity_.forget_moments();
  forget_averages(groups_);
  stale_ = true;
}

}  // namespace splatboost
