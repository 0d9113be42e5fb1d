// SPDX-License-Identifier: Apache-2.0
// Replaces cuda_bench.cu and cuda_limits.cu in a build without CUDA. Such a build cannot create a CudaStream, so these
// functions are never called.
#include "program/bench/cuda_bench.h"
#include "program/bench/cuda_limits.h"
#include "splatboost/errors.h"

namespace splatboost::program {
namespace {
[[noreturn]] void absent() { throw NoDeviceError("this build of SplatBoost has no CUDA"); }
}  // namespace

CudaDeviceFacts cuda_device_facts(const CudaStream&) { absent(); }
MachineLimits measure_limits(CudaStream&, const CudaProbe&) { absent(); }
CudaSamples measure_cuda_stages(const BenchScene&, CudaStream&, int, int) { absent(); }

}  // namespace splatboost::program
