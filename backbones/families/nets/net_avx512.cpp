// SPDX-License-Identifier: Apache-2.0
#define Eigen eigen_avx512
#include "families/nets/net_kernels-inl.h"

namespace splatboost {

NetKernels avx512_net_kernels() { return kKernels; }

}  // namespace splatboost
