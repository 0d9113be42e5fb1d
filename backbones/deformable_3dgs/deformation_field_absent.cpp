// SPDX-License-Identifier: Apache-2.0
// Replaces the .cu file in builds without nvcc or the cuBLAS header.
#include "deformable_3dgs/deformation_field.h"
#include "splatboost/errors.h"

namespace splatboost::cuda {

std::unique_ptr<DeformationField::Work> make_deformation_field(const DeformationShape&, CudaStream&) {
  throw NoDeviceError(
      "this build of SplatBoost cannot train deformation fields on a GPU; rebuild it with nvcc and cuBLAS installed");
}

}  // namespace splatboost::cuda
