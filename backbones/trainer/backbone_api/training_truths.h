// SPDX-License-Identifier: Apache-2.0
/// @file Truth images of a scene's training views in memory that a device can read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "splatboost/device.h"
#include "splatboost/truth_store.h"
#include "trainer/dataset/scene.h"

namespace splatboost {

/// Index of a training view, or of its half-size view, among the training views; none if `view` is not an element of
/// the scene (it may be a copy).
std::optional<std::size_t> training_index(const Scene& scene, const View& view);

/// The scene and the device must outlive it.
class TrainingTruths {
 public:
  TrainingTruths(const Scene& scene, Device device) : scene_(scene), device_(device) {}

  /// On a GPU, the first call uploads as many images as fit into a quarter of the free memory; the others are uploaded
  /// each time they are requested, as are views added after the first call and views outside the scene (levels of a
  /// pyramid).
  /// On a GPU, the result is valid for work submitted before the next call.
  TruthImage of(const View& view);

 private:
  const Scene& scene_;
  Device device_;
  std::optional<TruthStore> store_;  ///< on a GPU, from the first call on
  std::size_t stored_ = 0;           ///< training views in store_; their half-size views follow
};

}  // namespace splatboost
