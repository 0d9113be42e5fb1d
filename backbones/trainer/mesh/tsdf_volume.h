// SPDX-License-Identifier: Apache-2.0
/// @file Depth images fused into a truncated signed distance field (Curless and Levoy 1996), and its zero level set.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "splatboost/camera.h"
#include "splatboost/threads.h"
#include "trainer/mesh/triangle_mesh.h"

namespace splatboost {

/// Whether this build has OpenVDB, which meshes need. Without it, the constructor of TsdfVolume throws InputError.
bool has_tsdf_volumes();

struct TsdfOptions {
  float voxel = 0.01f;                               ///< side, world units
  float truncation = 0.04f;                          ///< distances are truncated at this, world units
  std::uint64_t max_bytes = std::uint64_t{4} << 30;  ///< memory limit of the volume
};

/// Only blocks of voxels near surfaces take memory. integrate() throws InputError if they would exceed max_bytes.
class TsdfVolume {
 public:
  explicit TsdfVolume(const TsdfOptions& options);
  ~TsdfVolume();

  /// @param depth [H,W] along z; 0: unknown
  /// @param color [3,H,W]
  void integrate(const Camera& camera, std::span<const float> depth, std::span<const float> color,
                 const Threads& threads);

  /// The zero level set in the cells whose eight corner voxels were each seen by at least `least_views` views.
  TriangleMesh mesh(int least_views, const Threads& threads) const;

  std::uint64_t bytes() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost
