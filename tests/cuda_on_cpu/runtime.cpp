// SPDX-License-Identifier: Apache-2.0
// Devices and their memory: host memory that is accessible only while kernels and copies run.
#include <sys/mman.h>

#include <cstdlib>
#include <map>

#include "accesses.h"
#include "cuda_runtime.h"

namespace {

int device_count = 1;
std::size_t device_memory = std::size_t{4} << 30;
std::size_t in_use = 0;
std::map<void*, std::size_t> allocations;
std::map<const void*, std::size_t> pinned;
thread_local int current_device = 0;

/// The address range of device memory, allocated in whole pages.
class Arena {
 public:
  static constexpr std::size_t kPage = 4096;

  Arena() {
    void* const at = mmap(nullptr, kReserved, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    begin_ = at == MAP_FAILED ? nullptr : static_cast<std::byte*>(at);
    if (begin_ == nullptr) return;
    free_[0] = kReserved;
    cuda_on_cpu::watch(begin_, kReserved);
  }
  /// Takes the first free range that is large enough; null if there is none.
  void* take(std::size_t bytes) {
    const std::size_t wanted = rounded(std::max<std::size_t>(bytes, 1));
    for (const auto& [offset, size] : free_) {
      if (size < wanted) continue;
      const std::size_t at = offset, left = size - wanted;
      free_.erase(at);
      if (left > 0) free_[at + wanted] = left;
      used_ = std::max(used_, at + wanted);
      if (open_ > 0) protect(PROT_READ | PROT_WRITE);
      return begin_ + at;
    }
    return nullptr;
  }
  void give_back(void* memory, std::size_t bytes) {
    const auto offset = static_cast<std::size_t>(static_cast<std::byte*>(memory) - begin_);
    auto here = free_.emplace(offset, rounded(std::max<std::size_t>(bytes, 1))).first;
    if (const auto next = std::next(here); next != free_.end() && here->first + here->second == next->first) {
      here->second += next->second;
      free_.erase(next);
    }
    if (here == free_.begin()) return;
    if (const auto before = std::prev(here); before->first + before->second == here->first) {
      before->second += here->second;
      free_.erase(here);
    }
  }
  bool holds(const void* memory) const {
    const auto* const at = static_cast<const std::byte*>(memory);
    return begin_ != nullptr && at >= begin_ && at < begin_ + kReserved;
  }
  void open() {
    if (open_++ == 0) protect(PROT_READ | PROT_WRITE);
  }
  void close() {
    if (--open_ == 0) protect(PROT_NONE);
  }

 private:
  static constexpr std::size_t kReserved = std::size_t{8} << 30;  // address space, not memory
  static std::size_t rounded(std::size_t bytes) { return (bytes + kPage - 1) / kPage * kPage; }
  void protect(int access) const {
    if (used_ > 0) static_cast<void>(mprotect(begin_, used_, access));
  }

  std::byte* begin_ = nullptr;
  std::map<std::size_t, std::size_t> free_;  ///< offset → size
  std::size_t used_ = 0;                     ///< end of the highest range ever taken
  int open_ = 0;
};

Arena& arena() {
  static Arena& whole = *new Arena;  // never destroyed: static objects may hold arrays in it
  return whole;
}

}  // namespace

namespace cuda_on_cpu {
DeviceAccess::DeviceAccess() { arena().open(); }
DeviceAccess::~DeviceAccess() { arena().close(); }
void set_device_memory(std::size_t bytes) { device_memory = bytes; }
std::size_t device_memory_in_use() { return in_use; }
void set_device_count(int count) { device_count = count; }
bool is_pageable(const void* memory) {
  if (arena().holds(memory)) return false;
  auto next = pinned.upper_bound(memory);
  if (next == pinned.begin()) return true;
  const auto& [begin, bytes] = *std::prev(next);
  return static_cast<const std::byte*>(memory) >= static_cast<const std::byte*>(begin) + bytes;
}
}  // namespace cuda_on_cpu

const char* cudaGetErrorString(cudaError_t error) {
  switch (error) {
    case cudaSuccess:
      return "no error";
    case cudaErrorInvalidValue:
      return "invalid argument";
    case cudaErrorMemoryAllocation:
      return "out of memory";
    case cudaErrorInvalidConfiguration:
      return "invalid configuration argument";
    case cudaErrorNoDevice:
      return "no CUDA-capable device is detected";
    case cudaErrorInvalidDevice:
      return "invalid device ordinal";
    default:
      return "unknown error";
  }
}

cudaError_t cudaGetDeviceCount(int* count) {
  *count = device_count;
  return device_count > 0 ? cudaSuccess : cudaErrorNoDevice;
}

cudaError_t cudaGetDevice(int* device) {
  *device = current_device;
  return device_count > 0 ? cudaSuccess : cudaErrorNoDevice;
}

cudaError_t cudaSetDevice(int device) {
  if (device < 0 || device >= device_count) return cudaErrorInvalidDevice;
  current_device = device;
  return cudaSuccess;
}

cudaError_t cudaGetDeviceProperties(cudaDeviceProp* properties, int) {
  *properties = {"CUDA on the CPU", device_memory, 8, 0};
  return cudaSuccess;
}

cudaError_t cudaDriverGetVersion(int* version) {
  *version = 12000;
  return cudaSuccess;
}

cudaError_t cudaRuntimeGetVersion(int* version) { return cudaDriverGetVersion(version); }

cudaError_t cudaMalloc(void** memory, std::size_t bytes) {
  if (bytes > device_memory - std::min(in_use, device_memory)) return cudaErrorMemoryAllocation;
  *memory = arena().take(bytes);
  if (*memory == nullptr) return cudaErrorMemoryAllocation;
  const cuda_on_cpu::DeviceAccess access;
  std::memset(*memory, 0xff, bytes);  // NaN as floats, so that reads of unwritten memory are noticed
  cuda_on_cpu::forget(*memory, bytes);
  allocations[*memory] = bytes;
  in_use += bytes;
  return cudaSuccess;
}

cudaError_t cudaFree(void* memory) {
  const auto found = allocations.find(memory);
  if (found == allocations.end()) return memory == nullptr ? cudaSuccess : cudaErrorInvalidValue;
  cuda_on_cpu::finish_everything();
  cuda_on_cpu::forget(memory, found->second);  // so that later reads are noticed
  in_use -= found->second;
  arena().give_back(memory, found->second);
  allocations.erase(found);
  return cudaSuccess;
}

cudaError_t cudaMemGetInfo(std::size_t* free, std::size_t* total) {
  *free = device_memory - std::min(in_use, device_memory);
  *total = device_memory;
  return cudaSuccess;
}

cudaError_t cudaMallocHost(void** memory, std::size_t bytes) {
  *memory = std::malloc(bytes);
  if (*memory == nullptr) return cudaErrorMemoryAllocation;
  std::memset(*memory, 0xff, bytes);  // so that reads before a copy has arrived are noticed
  pinned[*memory] = bytes;
  return cudaSuccess;
}

cudaError_t cudaFreeHost(void* memory) {
  if (memory != nullptr && pinned.erase(memory) == 0) return cudaErrorInvalidValue;
  cuda_on_cpu::finish_everything();
  std::free(memory);
  return cudaSuccess;
}
