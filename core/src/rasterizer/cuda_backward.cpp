// SPDX-License-Identifier: Apache-2.0
#include "splatboost/cuda_backward.h"

#include <atomic>

namespace splatboost {
namespace {
std::atomic<CudaBackward> chosen = CudaBackward::per_pixel;
}  // namespace

void use_cuda_backward(CudaBackward way) { chosen = way; }
CudaBackward cuda_backward() { return chosen; }

}  // namespace splatboost
