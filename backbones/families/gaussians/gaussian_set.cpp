// SPDX-License-Identifier: Apache-2.0
#include "families/gaussians/gaussian_trainer.h"

#include <algorithm>
#include <set>
#include <string_view>
#include <utility>

#include <glm/gtc/quaternion.hpp>

#include "splatboost/constants.h"
#include "splatboost/neighbors.h"
#include "splatboost/rows.h"
#include "splatboost/spatial_order.h"

namespace splatboost {
namespace {

constexpr float kMinSquaredDistance = 1e-7f;  // between neighbours at initialisation; keeps log scales finite

void append_rows(TrainedGroup& group, std::span<const float> rows) {
  const std::size_t first = group.values.size();
  for (Array<float>* tensor : {&group.values, &group.gradients, &group.first_moments, &group.second_moments}) {
    append_zero_rows(*tensor, group.width, rows.size() / group.width);
  }
  group.values.edit(first, [&](std::span<float> values) { std::ranges::copy(rows, values.begin()); });
}

}  // namespace

void GaussianTrainer::initialise() {
  own_groups_ = {&xyz_, &f_dc_, &f_rest_, &opacity_, &scaling_, &rotation_};
  groups_ = own_groups_;
  for (TrainedGroup* group : method_->groups()) groups_.push_back(group);
  std::set<std::string_view> names;
  for (TrainedGroup* group : groups_) {
    SPLATBOOST_CHECK(names.insert(group->name).second, "two parameter groups have the name " + group->name);
    if (group->shape == GroupShape::rows) row_groups_.push_back(group);
  }
  const PointCloud points = starting_points(context_.scene);
  const std::size_t most = context_.max_primitives > 0 ? context_.max_primitives : points.size();
  NewRows rows = rows_of(points, most);
  const std::size_t n = rows.points.size();
  xyz_.assign(std::move(rows.means));
  f_dc_.assign(std::move(rows.dc));
  f_rest_.assign(std::vector<float>(n * 3 * kRestRows, 0.0f));
  opacity_.assign(std::vector<float>(n, logit(config_.initial_opacity)));
  scaling_.assign(std::move(rows.log_scales));
  rotation_.assign(std::move(rows.rotations));
  method_->start(xyz_.values);
  reorder();
  restart_statistics();
  activate();
}

NewRows GaussianTrainer::rows_of(const PointCloud& points, std::size_t most) const {
  NewRows rows;
  const std::size_t n = std::min(points.size(), most);
  rows.points.reserve(n);
  rows.means.reserve(3 * n);
  rows.dc.reserve(3 * n);
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t from = i * points.size() / n;
    rows.points.push_back(static_cast<std::uint32_t>(from));
    for (std::size_t c = 0; c < 3; ++c) {
      rows.means.push_back(points.positions[3 * from + c]);
      rows.dc.push_back((static_cast<float>(points.colors[3 * from + c]) / 255.0f - 0.5f) / kShConstant);
    }
  }
  std::vector<float> squared(n);
  mean_squared_neighbor_distances(rows.means, 3, squared, context_.threads);
  for (const float d : squared) {
    rows.log_scales.insert(rows.log_scales.end(), 3, 0.5f * std::log(std::max(d, kMinSquaredDistance)));
    rows.rotations.insert(rows.rotations.end(), {1, 0, 0, 0});
  }
  return rows;
}

std::vector<std::uint32_t> GaussianTrainer::insert(const PointCloud& points) {
  const std::size_t before = primitives();
  std::size_t most = points.size();
  if (context_.max_primitives > 0) most = context_.max_primitives - std::min(context_.max_primitives, before);
  NewRows rows = rows_of(points, most);
  const std::size_t n = rows.points.size();
  if (n == 0) return {};
  f_rest_.expand();
  forget_averages(groups_);
  // Reserve all groups first: if memory runs out, the model stays intact.
  for (TrainedGroup* group : row_groups_) group->reserve_rows(before + n);
  append_rows(xyz_, rows.means);
  append_rows(f_dc_, rows.dc);
  append_rows(opacity_, std::vector<float>(n, logit(config_.initial_opacity)));
  append_rows(scaling_, rows.log_scales);
  append_rows(rotation_, rows.rotations);
  for (TrainedGroup* group : row_groups_) {
    if (group->rows() == before) append_rows(*group, std::vector<float>(n * group->width, 0.0f));
  }
  for (Array<float>* sums : {&gradient_sum_, &gradient_abs_sum_, &seen_}) append_zero_rows(*sums, 1, n);
  stale_ = set_changed_ = true;
  return std::move(rows.points);
}

void GaussianTrainer::transform(std::span<const std::int32_t> which, std::span<const Similarity> transforms) {
  SPLATBOOST_CHECK(which.size() == primitives(), "there must be one transform index, or -1, per Gaussian");
  step_all();
  const auto for_each_moved = [&](std::span<float> values, std::size_t width, const auto& move) {
    for (std::size_t i = 0; i < which.size(); ++i) {
      if (which[i] >= 0) move(&values[width * i], transforms[static_cast<std::size_t>(which[i])]);
    }
  };
  xyz_.values.edit(0, [&](std::span<float> values) {
    for_each_moved(values, 3, [](float* mean, const Similarity& by) {
      const glm::dvec3 moved = by.scale * (by.rotation * glm::dvec3(mean[0], mean[1], mean[2])) + by.translation;
      for (int c = 0; c < 3; ++c) mean[c] = static_cast<float>(moved[c]);
    });
  });
  rotation_.values.edit(0, [&](std::span<float> values) {
    for_each_moved(values, 4, [](float* q, const Similarity& by) {
      const glm::dquat turned = glm::quat_cast(by.rotation) * glm::dquat(q[0], q[1], q[2], q[3]);
      const double wxyz[4] = {turned.w, turned.x, turned.y, turned.z};
      for (int c = 0; c < 4; ++c) q[c] = static_cast<float>(wxyz[c]);
    });
  });
  scaling_.values.edit(0, [&](std::span<float> values) {
    for_each_moved(values, 3, [](float* logarithms, const Similarity& by) {
      for (int c = 0; c < 3; ++c) logarithms[c] += static_cast<float>(std::log(by.scale));
    });
  });
  xyz_.forget_moments();
  rotation_.forget_moments();
  forget_averages(groups_);
  restart_statistics();
  stale_ = set_changed_ = true;
}

void GaussianTrainer::remove(std::span<const std::uint8_t> removed) {
  select({device_, kept_rows(removed)});
  drop_removed(removed, origins_);
}

void GaussianTrainer::select(const Array<std::uint32_t>& rows) {
  f_rest_.expand();
  select_rows(row_groups_, rows, workspace_, device_);
  stale_ = set_changed_ = true;
}

/// Sorts Gaussians in spatial order, because growth appends new ones at the end; improves cache locality.
void GaussianTrainer::reorder() {
  Array<std::uint32_t> order(device_);
  order.ensure(primitives());
  spatial_order(xyz_.values, order, device_);
  select(order);
}

}  // namespace splatboost
