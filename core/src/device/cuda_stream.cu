// SPDX-License-Identifier: Apache-2.0
#include "splatboost/cuda_stream.h"

#include <cuda_runtime.h>

#include <algorithm>
#include <atomic>

#include "splatboost/errors.h"

namespace splatboost {
namespace {

std::atomic<std::uint64_t> all_allocations{0}, all_synchronizations{0};

cudaStream_t stream_of(void* handle) { return static_cast<cudaStream_t>(handle); }
cudaEvent_t event_of(void* handle) { return static_cast<cudaEvent_t>(handle); }

/// Whether the device reads pageable host memory through the host's page tables: then a copy from it may run after the
/// call has returned.
bool reads_pageable_memory(int ordinal) {
  int reads = 0;
  return cudaDeviceGetAttribute(&reads, cudaDevAttrPageableMemoryAccessUsesHostPageTables, ordinal) == cudaSuccess &&
         reads != 0;
}

std::string not_enough(const std::string& wanted) {
  std::size_t free = 0, total = 0;
  static_cast<void>(cudaMemGetInfo(&free, &total));
  return "out of device memory: " + wanted + ", " + std::to_string(free) + " of " + std::to_string(total) + " free";
}

[[noreturn]] void throw_no_device(int ordinal) {
  int devices = 0;
  const cudaError_t found = cudaGetDeviceCount(&devices);
  const std::string why = found != cudaSuccess ? cudaGetErrorString(found) : std::to_string(devices) + " found";
  static_cast<void>(cudaGetLastError());
  throw NoDeviceError("no CUDA device " + std::to_string(ordinal) + " on this machine (" + why + ")");
}

}  // namespace

int cuda_device_count() noexcept {
  int devices = 0;
  if (cudaGetDeviceCount(&devices) == cudaSuccess) return devices;
  static_cast<void>(cudaGetLastError());
  return 0;
}

const char* cuda_architectures() noexcept {
#ifdef __CUDA_ARCH_LIST__
  // 750, 900 … as "7.5, 9.0 …"; nvcc defines the list from its options, with `native` resolved.
  static const std::string text = [] {
    std::string list;
    for (const int architecture : {__CUDA_ARCH_LIST__}) {
      list += (list.empty() ? "" : ", ") + std::to_string(architecture / 100) + "." +
              std::to_string(architecture / 10 % 10);
    }
    return list;
  }();
  return text.c_str();
#else
  return "the CPU";  // the emulator of the tests (tests/cuda_on_cpu)
#endif
}

CudaStream::CudaStream(int ordinal) : ordinal_(ordinal), owned_(true) {
  if (ordinal < 0 || ordinal >= cuda_device_count()) throw_no_device(ordinal);
  make_current();
  cudaStream_t stream = nullptr;
  check(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking), "cudaStreamCreate");
  handle_ = stream;
}

CudaStream::~CudaStream() {
  if (end_of_call_ != nullptr) static_cast<void>(cudaEventDestroy(event_of(end_of_call_)));
  if (owned_) static_cast<void>(cudaStreamDestroy(stream_of(handle_)));
}

CudaActivity CudaStream::total_activity() noexcept { return {all_allocations.load(), all_synchronizations.load()}; }

void CudaStream::count_allocation() {
  ++activity_.allocations;
  ++all_allocations;
}

std::string CudaStream::device_name() const {
  cudaDeviceProp properties{};
  check(cudaGetDeviceProperties(&properties, ordinal_), "cudaGetDeviceProperties");
  return properties.name;
}

std::size_t CudaStream::free_memory() const {
  make_current();
  std::size_t free = 0, total = 0;
  check(cudaMemGetInfo(&free, &total), "cudaMemGetInfo");
  return free;
}

void CudaStream::synchronize() {
  make_current();  // a null handle means the default stream of the current device
  check(cudaStreamSynchronize(stream_of(handle_)), "waiting for the device");
  count_synchronization(launches_);
}

void* CudaStream::allocate(std::size_t bytes) {
  if (bytes == 0) return nullptr;
  count_allocation();
  make_current();
  void* memory = nullptr;
  const cudaError_t error = cudaMalloc(&memory, bytes);
  if (error == cudaErrorMemoryAllocation) {
    static_cast<void>(cudaGetLastError());  // clears the error, which is not sticky: the stream remains usable
    throw DeviceMemoryError(not_enough(std::to_string(bytes) + " bytes requested"));
  }
  check(error, "cudaMalloc");
  return memory;
}

void CudaStream::release(void* memory) noexcept {
  if (memory != nullptr) static_cast<void>(cudaFree(memory));
}

void* CudaStream::allocate_pinned(std::size_t bytes) {
  count_allocation();
  make_current();
  void* memory = nullptr;
  const cudaError_t error = cudaMallocHost(&memory, std::max<std::size_t>(bytes, 1));
  if (error == cudaErrorMemoryAllocation) {
    static_cast<void>(cudaGetLastError());
    throw DeviceMemoryError("out of pinned host memory: " + std::to_string(bytes) + " bytes requested");
  }
  check(error, "cudaMallocHost");
  return memory;
}

void CudaStream::release_pinned(void* memory) noexcept {
  if (memory != nullptr) static_cast<void>(cudaFreeHost(memory));
}

void CudaStream::copy_to_device(void* to, const void* from, std::size_t bytes) {
  copy_from_pinned(to, from, bytes);  // the same CUDA call, which detects pageable memory
  if (bytes == 0 || !reads_pageable_memory(ordinal_)) return;
  check(cudaStreamSynchronize(stream_of(handle_)), "copying to the device");
}

void CudaStream::copy_from_pinned(void* to, const void* from, std::size_t bytes) {
  if (bytes == 0) return;
  make_current();
  check(cudaMemcpyAsync(to, from, bytes, cudaMemcpyHostToDevice, stream_of(handle_)), "copying to the device");
}

void CudaStream::copy_on_device(void* to, const void* from, std::size_t bytes) {
  if (bytes == 0) return;
  make_current();
  check(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDeviceToDevice, stream_of(handle_)), "copying on the device");
}

void CudaStream::copy_to_host(void* to, const void* from, std::size_t bytes) {
  if (bytes == 0) return;
  make_current();
  check(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDeviceToHost, stream_of(handle_)), "copying from the device");
  synchronize();
}

void CudaStream::copy_to_pinned(void* to, const void* from, std::size_t bytes) {
  if (bytes == 0) return;
  make_current();
  check(cudaMemcpyAsync(to, from, bytes, cudaMemcpyDeviceToHost, stream_of(handle_)), "copying from the device");
}

void CudaStream::fill_zero(void* memory, std::size_t bytes) {
  if (bytes == 0) return;
  make_current();
  check(cudaMemsetAsync(memory, 0, bytes, stream_of(handle_)), "clearing device memory");
}

void CudaStream::make_current() const { check(cudaSetDevice(ordinal_), "cudaSetDevice"); }

void CudaStream::begin_launch(const char* kernel) {
  make_current();
  kernels_[launches_++ % kRememberedKernels] = kernel;
}

void CudaStream::end_launch(int error) {
  if (error == cudaSuccess) return;
  static_cast<void>(cudaGetLastError());  // clears it: CUB would report it as an error of its own
  if (error == cudaErrorMemoryAllocation) {
    throw DeviceMemoryError(not_enough(std::string("kernel ") + kernels_[(launches_ - 1) % kRememberedKernels]));
  }
  throw DeviceError(std::string("kernel ") + kernels_[(launches_ - 1) % kRememberedKernels] +
                    " was not launched: " + cudaGetErrorString(static_cast<cudaError_t>(error)) + recent_kernels());
}

void CudaStream::count_synchronization(std::size_t launches) {
  ++activity_.synchronizations;
  ++all_synchronizations;
  finished_ = std::max(finished_, launches);
}

void CudaStream::check(int error, const char* what) const {
  if (error == cudaSuccess) return;
  static_cast<void>(cudaGetLastError());  // clears it: CUB would report it as an error of its own
  if (error == cudaErrorMemoryAllocation) throw DeviceMemoryError(not_enough(what));
  throw DeviceError(std::string(what) + " failed: " + cudaGetErrorString(static_cast<cudaError_t>(error)) +
                    recent_kernels());
}

std::string CudaStream::recent_kernels() const {
  if (launches_ == finished_) return "";
  std::string names;
  const std::size_t known = std::min(launches_ - finished_, kRememberedKernels);
  for (std::size_t k = launches_ - known; k < launches_; ++k) {
    names += (names.empty() ? "" : ", ") + std::string(kernels_[k % kRememberedKernels]);
  }
  return " (kernels since the last synchronization: " + names + "; set CUDA_LAUNCH_BLOCKING=1 to find which one)";
}

CudaCall::CudaCall(CudaStream& stream, void* handle) : stream_(stream) {
  cudaError_t error = cudaGetDevice(&device_before_);
  if (error == cudaSuccess) error = cudaSetDevice(stream.ordinal_);
  if (error != cudaSuccess) {
    if (stream.ordinal_ < 0 || stream.ordinal_ >= cuda_device_count()) throw_no_device(stream.ordinal_);
    stream.check(error, "cudaSetDevice");
  }
  stream.handle_ = handle;
  if (stream.end_of_call_ == nullptr) return;
  error = cudaStreamWaitEvent(stream_of(handle), event_of(stream.end_of_call_), 0);
  if (error == cudaSuccess) return;
  static_cast<void>(cudaSetDevice(device_before_));
  stream.check(error, "waiting for the previous call");
}

CudaCall::~CudaCall() {
  // The next call waits for this event, because it cannot refer to this stream, which the caller may have destroyed.
  cudaEvent_t end = event_of(stream_.end_of_call_);
  if (end != nullptr || cudaEventCreateWithFlags(&end, cudaEventDisableTiming) == cudaSuccess) {
    stream_.end_of_call_ = end;
    static_cast<void>(cudaEventRecord(end, stream_of(stream_.handle_)));
  }
  if (device_before_ != stream_.ordinal_) static_cast<void>(cudaSetDevice(device_before_));
}

}  // namespace splatboost
