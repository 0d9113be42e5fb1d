// SPDX-License-Identifier: Apache-2.0
#include "trainer/backbone_api/training_truths.h"

#include <functional>
#include <vector>

#include "splatboost/cuda_stream.h"

namespace splatboost {
namespace {

/// 1/kShare of a GPU's free memory is used for truth images.
constexpr std::size_t kShare = 4;

/// Index of the view if it is an element of `views`.
std::optional<std::size_t> place_in(const std::vector<View>& views, const View& view) {
  const View* const at = &view;
  if (std::less<>()(at, views.data()) || !std::less<>()(at, views.data() + views.size())) return std::nullopt;
  return static_cast<std::size_t>(at - views.data());
}

}  // namespace

std::optional<std::size_t> training_index(const Scene& scene, const View& view) {
  const std::optional<std::size_t> index = place_in(scene.train, view);
  return index ? index : place_in(scene.train_halves, view);
}

TruthImage TrainingTruths::of(const View& view) {
  if (!device_.is_cuda()) return view.truth();
  if (!store_) {
    std::vector<TruthImage> images;
    for (const auto* views : {&scene_.train, &scene_.train_halves}) {
      for (const View& each : *views) images.push_back(each.truth());
    }
    stored_ = scene_.train.size();
    store_.emplace(std::move(images), device_.stream().free_memory() / kShare, device_);
  }
  const std::optional<std::size_t> index = place_in(scene_.train, view);
  if (index && *index < stored_) return store_->get(*index);
  if (const std::optional<std::size_t> half = place_in(scene_.train_halves, view)) return store_->get(stored_ + *half);
  return store_->upload(view.truth());
}

}  // namespace splatboost
