// SPDX-License-Identifier: Apache-2.0
// Replaces the .cu files of this folder in a build without CUDA.
#include "device/cuda_absent.h"

#include "device/cuda_ops.h"
#include "splatboost/cuda_laps.h"
#include "splatboost/cuda_stream.h"
#include "splatboost/errors.h"

namespace splatboost {

int cuda_device_count() noexcept { return 0; }
const char* cuda_architectures() noexcept { return ""; }
CudaActivity CudaStream::total_activity() noexcept { return {}; }
CudaCall::CudaCall(CudaStream& stream, void*) : stream_(stream) { absent(); }
CudaCall::~CudaCall() = default;

CudaStream::CudaStream(int) { absent(); }
CudaStream::~CudaStream() = default;
std::string CudaStream::device_name() const { absent(); }
std::size_t CudaStream::free_memory() const { absent(); }
void CudaStream::synchronize() { absent(); }
void* CudaStream::allocate(std::size_t) { absent(); }
void CudaStream::release(void*) noexcept {}
void* CudaStream::allocate_pinned(std::size_t) { absent(); }
void CudaStream::release_pinned(void*) noexcept {}
void CudaStream::copy_to_device(void*, const void*, std::size_t) { absent(); }
void CudaStream::copy_from_pinned(void*, const void*, std::size_t) { absent(); }
void CudaStream::copy_on_device(void*, const void*, std::size_t) { absent(); }
void CudaStream::copy_to_host(void*, const void*, std::size_t) { absent(); }
void CudaStream::copy_to_pinned(void*, const void*, std::size_t) { absent(); }
void CudaStream::fill_zero(void*, std::size_t) { absent(); }
void CudaStream::make_current() const { absent(); }
void CudaStream::begin_launch(const char*) { absent(); }
void CudaStream::end_launch(int) { absent(); }
void CudaStream::count_synchronization(std::size_t) { absent(); }
void CudaStream::check(int, const char*) const { absent(); }

struct CudaLaps::State {};
CudaLaps::CudaLaps(CudaStream&) { absent(); }
CudaLaps::~CudaLaps() = default;
CudaLaps::CudaLaps(CudaLaps&&) noexcept = default;
CudaLaps& CudaLaps::operator=(CudaLaps&&) noexcept = default;
void CudaLaps::mark(const char*) { absent(); }
std::optional<CudaLaps::Lap> CudaLaps::take() { absent(); }

namespace cuda {

struct PinnedUploads::State {};
PinnedUploads::PinnedUploads(CudaStream&) { absent(); }
PinnedUploads::~PinnedUploads() = default;
void PinnedUploads::upload(std::span<const std::uint8_t>, std::span<const std::uint8_t>, std::uint8_t*) { absent(); }

}  // namespace cuda

}  // namespace splatboost
