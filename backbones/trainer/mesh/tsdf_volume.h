// SPDX-License-Identifier: Apache-2.0
/// @file Depth images fused into a truncated signed distance field (Curless and Levoy 1996), and the mesh of its zero.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "splatboost/camera.h"
#include "splatboost/threads.h"
#include "trainer/mesh/triangle_mesh.h"

namespace splatboost {

/// Whether this build can make meshes: it needs OpenVDB. Otherwise a TsdfVolume throws an InputError that says so.
bool has_tsdf_volumes();

struct TsdfOptions {
  float voxel = 0.01f;                               ///< side, world units
  float truncation = 0.04f;                          ///< distances are kept up to this, world units
  std::uint64_t max_bytes = std::uint64_t{4} << 30;  ///< of the volume
};

/// Blocks of voxels near surfaces alone take memory. Throws InputError where that would pass max_bytes.
class TsdfVolume {
 public:
  explicit TsdfVolume(const TsdfOptions& options);
  ~TsdfVolume();

  /// @param depth [H,W] along z; 0: nothing is known
  /// @param color [3,H,W]
  void integrate(const Camera& camera, std::span<const float> depth, std::span<const float> color, Threads& threads);

  /// The zero between voxels that were all seen at least so often.
  TriangleMesh mesh(int least_views, Threads& threads) const;

  std::uint64_t bytes() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost
