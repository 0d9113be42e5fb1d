// SPDX-License-Identifier: Apache-2.0
// Replaces tsdf_volume_openvdb.cpp in a build without OpenVDB.
#include "trainer/mesh/tsdf_volume.h"
#include "trainer/support/input_error.h"

namespace splatboost {

struct TsdfVolume::State {};

bool has_tsdf_volumes() { return false; }
TsdfVolume::TsdfVolume(const TsdfOptions&) {
  throw InputError(
      "this build cannot create meshes; install OpenVDB (Debian: libopenvdb-dev libboost-dev) and build again");
}
TsdfVolume::~TsdfVolume() = default;
void TsdfVolume::integrate(const Camera&, std::span<const float>, std::span<const float>, const Threads&) {}
TriangleMesh TsdfVolume::mesh(int, const Threads&) const { return {}; }
std::uint64_t TsdfVolume::bytes() const { return 0; }

}  // namespace splatboost
