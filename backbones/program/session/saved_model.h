// SPDX-License-Identifier: Apache-2.0
/// @file The model of an earlier run.
#pragma once

#include <filesystem>
#include <optional>

#include "program/session/run.h"
#include "program/session/run_options.h"

namespace splatboost::program {

struct SavedModel {
  std::filesystem::path folder;  ///< folder of the saved iteration
  std::optional<float> beta;     ///< --beta, or the one it was trained with; none: the backbone's own box
};

/// A model ready to render, with its scene and its device. It cannot be copied or moved because the backbone refers to
/// both.
class OpenModel {
 public:
  OpenModel(const SavedModel& model, const RunOptions& options);
  OpenModel(const OpenModel&) = delete;
  OpenModel& operator=(const OpenModel&) = delete;

  Workbench& bench() { return bench_; }
  const Scene& scene() const { return bench_.scene; }
  Backbone& backbone() { return *plugged_.backbone; }

 private:
  Workbench bench_;
  PluggedBackbone plugged_;
};

}  // namespace splatboost::program
