// SPDX-License-Identifier: Apache-2.0
// What a build without CUDA has in place of the .cu files. There is no stream, so nothing else here is ever reached.
#include "splatboost/cuda_stream.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {
[[noreturn]] void absent() {
  throw NoDeviceError("this build of SplatBoost has no CUDA: build it where nvcc is installed, or use the CPU");
}
}  // namespace

CudaStream::CudaStream(int) { absent(); }
CudaStream::~CudaStream() = default;
std::string CudaStream::device_name() const { absent(); }
void CudaStream::synchronize() { absent(); }
void* CudaStream::allocate(std::size_t) { absent(); }
void CudaStream::release(void*) noexcept {}
void* CudaStream::allocate_pinned(std::size_t) { absent(); }
void CudaStream::release_pinned(void*) noexcept {}
void CudaStream::copy_to_device(void*, const void*, std::size_t) { absent(); }
void CudaStream::copy_on_device(void*, const void*, std::size_t) { absent(); }
void CudaStream::copy_to_host(void*, const void*, std::size_t) { absent(); }
void CudaStream::copy_to_pinned(void*, const void*, std::size_t) { absent(); }
void CudaStream::fill_zero(void*, std::size_t) { absent(); }
void CudaStream::begin_launch(const char*) { absent(); }
void CudaStream::end_launch(int) { absent(); }
void CudaStream::count_synchronization() { absent(); }

}  // namespace splatboost
