// SPDX-License-Identifier: Apache-2.0
#define Eigen eigen_avx2
#include "families/nets/net_kernels-inl.h"
// Uses the header above.
#include "families/nets/deep_net_kernels-inl.h"

namespace splatboost {

NetKernels avx2_net_kernels() { return kKernels; }
DeepNetKernels<float> avx2_deep_net_kernels() { return kDeepKernels<float>; }

}  // namespace splatboost
