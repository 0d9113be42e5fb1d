// SPDX-License-Identifier: Apache-2.0
/// @file Inspects an anchor backbone through its public interface: exported rows, checkpoints, quality.
#pragma once

#include <numeric>
#include <string>
#include <vector>

#include "support/backbone_checks.h"
#include "trainer/dataset/splat_ply.h"
#include "trainer/evaluation/metrics.h"

namespace splatboost::testing {

/// Columns [N,width] of the exported .ply, by names prefix + "0", "1" …, or just the names given.
inline std::vector<float> exported(const Backbone& backbone, const std::vector<std::string>& names) {
  const test::TemporaryFolder folder;
  backbone.export_model(folder.path());
  return read_float_ply(folder / "point_cloud.ply", names).values;
}

inline std::vector<std::string> numbered(const std::string& prefix, std::size_t count) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < count; ++i) names.push_back(prefix + std::to_string(i));
  return names;
}

inline std::vector<float> exported(const Backbone& backbone, const std::string& prefix, std::size_t count) {
  return exported(backbone, numbered(prefix, count));
}

/// World positions of all slots [N·k,3], from the exported .ply.
inline std::vector<float> slot_positions(const Backbone& backbone, std::size_t k) {
  const std::vector<float> anchors = exported(backbone, {"x", "y", "z"});
  const std::vector<float> offsets = exported(backbone, "f_offset_", 3 * k);
  const std::vector<float> scaling = exported(backbone, "scale_", 3);
  std::vector<float> positions;
  for (std::size_t i = 0; i < anchors.size() / 3; ++i) {
    for (std::size_t j = 0; j < k; ++j) {
      for (std::size_t c = 0; c < 3; ++c) {
        positions.push_back(anchors[3 * i + c] + offsets[3 * k * i + k * c + j] * std::exp(scaling[3 * i + c]));
      }
    }
  }
  return positions;
}

inline double mean_psnr(Backbone& backbone, const std::vector<View>& views) {
  double sum = 0;
  for (const View& view : views) {
    std::vector<float> color = picture(backbone, view);
    for (float& value : color) value = std::clamp(value, 0.0f, 1.0f);
    sum += psnr(color, view.truth()) / static_cast<double>(views.size());
  }
  return sum;
}

}  // namespace splatboost::testing
