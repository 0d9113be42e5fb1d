// SPDX-License-Identifier: Apache-2.0
// What a build has in place of the .cu file where nvcc or cuBLAS's header is missing.
#include "deformable_3dgs/deformation_field.h"
#include "splatboost/errors.h"

namespace splatboost::cuda {

std::unique_ptr<DeformationField::Work> make_deformation_field(const DeformationShape&, CudaStream&) {
  throw NoDeviceError(
      "this build of SplatBoost trains no deformation fields on a GPU: build it where nvcc and cuBLAS are installed");
}

}  // namespace splatboost::cuda
