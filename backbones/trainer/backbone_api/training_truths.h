// SPDX-License-Identifier: Apache-2.0
/// @file Truth images of a scene's training views, where a device reads them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "splatboost/array.h"
#include "splatboost/device.h"
#include "splatboost/truth_store.h"
#include "trainer/dataset/scene.h"

namespace splatboost {

/// The place of a training view, or of its half, among the scene's training views; none: it is not one of them, but
/// perhaps a copy.
std::optional<std::size_t> training_index(const Scene& scene, const View& view);

/// The scene and the device must outlive it.
class TrainingTruths {
 public:
  TrainingTruths(const Scene& scene, Device device) : scene_(scene), device_(device) {}

  /// On a GPU the first call uploads what part of the images a quarter of the free memory holds; the others are
  /// uploaded when they are asked for.
  /// Views that came after the first call, or that are none of the scene's (levels of a pyramid), are uploaded each
  /// time.
  TruthImage of(const View& view);

 private:
  const Scene& scene_;
  Device device_;
  std::optional<TruthStore> store_;                      ///< of a GPU, from the first call on
  std::size_t stored_ = 0;                               ///< training views in it; their halves follow
  Array<std::uint8_t> color_{device_}, valid_{device_};  ///< of a view that is not in it
};

}  // namespace splatboost
