// SPDX-License-Identifier: Apache-2.0
#define Eigen eigen_avx512
#include "families/nets/net_kernels-inl.h"
// Uses the header above.
#include "families/nets/deep_net_kernels-inl.h"

namespace splatboost {

NetKernels avx512_net_kernels() { return kKernels; }
DeepNetKernels<float> avx512_deep_net_kernels() { return kDeepKernels<float>; }

}  // namespace splatboost
