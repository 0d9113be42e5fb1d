// SPDX-License-Identifier: Apache-2.0
/// @file A stream of a CUDA device: what every CUDA operation takes, and the only way to allocate device memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

namespace splatboost {

/// What must not happen in the training loop: tests check that these stay 0.
struct CudaActivity {
  std::uint64_t allocations = 0;       ///< of memory of the device, and of memory of the host that it can reach
  std::uint64_t synchronizations = 0;  ///< times that the host waited for the device
};

/// Devices that CUDA finds on this machine; 0 where there is no driver, and in a build without CUDA.
int cuda_device_count() noexcept;

/// What the .cu files were compiled for, such as "7.5, 9.0"; empty in a build without CUDA.
const char* cuda_architectures() noexcept;

/// Owns a stream, or borrows the caller's stream (CudaCall). Work that is given to it runs in order, while
/// the host goes on. Not thread safe.
///
/// A build without CUDA has this class too; its constructor throws NoDeviceError. A kernel that fails is reported by
/// the next call that looks at the device, as a DeviceError that names the kernels it may have been: those launched
/// since the last synchronisation, or just the one where CUDA_LAUNCH_BLOCKING=1 is set.
class CudaStream {
 public:
  /// Throws NoDeviceError where the machine has no device of that number.
  explicit CudaStream(int ordinal = 0);
  /// Goes along with a stream of the caller's, which stays the caller's: a cudaStream_t, nullptr for the device's
  /// default stream. Costs nothing: the device is not asked.
  CudaStream(int ordinal, void* handle) : ordinal_(ordinal), handle_(handle) {}
  ~CudaStream();
  CudaStream(const CudaStream&) = delete;
  CudaStream& operator=(const CudaStream&) = delete;

  int ordinal() const { return ordinal_; }
  std::string device_name() const;
  /// Bytes of free device memory.
  std::size_t free_memory() const;
  /// Its cudaStream_t.
  void* handle() const { return handle_; }
  /// Waits for all work given so far.
  void synchronize();
  const CudaActivity& activity() const { return activity_; }
  /// Of all streams of the process since it began.
  static CudaActivity total_activity() noexcept;

  // Memory, in bytes. DeviceArray is the comfortable way to it.
  /// Throws DeviceMemoryError.
  void* allocate(std::size_t bytes);
  void release(void* memory) noexcept;
  /// Memory of the host that the device writes to and reads from while the host goes on.
  void* allocate_pinned(std::size_t bytes);
  void release_pinned(void* memory) noexcept;
  /// `from` may change as soon as this returns. It is not pinned: the driver may wait for work given before, which is
  /// not counted. Do not call it in the training loop.
  void copy_to_device(void* to, const void* from, std::size_t bytes);
  /// Does not wait; `from` is pinned.
  void copy_from_pinned(void* to, const void* from, std::size_t bytes);
  void copy_on_device(void* to, const void* from, std::size_t bytes);
  /// Waits until the copy is done.
  void copy_to_host(void* to, const void* from, std::size_t bytes);
  /// Does not wait; `to` is pinned.
  void copy_to_pinned(void* to, const void* from, std::size_t bytes);
  void fill_zero(void* memory, std::size_t bytes);

  /// Makes the device the calling thread's.
  void make_current() const;
  /// Makes the device current and writes down a kernel that is about to be launched. @param kernel a literal
  void begin_launch(const char* kernel);
  /// @param error the launch's cudaError_t
  void end_launch(int error);
  /// Counts a wait that happened elsewhere.
  void count_synchronization();
  /// Throws DeviceError, or DeviceMemoryError, where a cudaError_t is none of success.
  void check(int error, const char* what) const;

 private:
  friend class CudaCall;
  static constexpr std::size_t kRememberedKernels = 32;
  void count_allocation();
  std::string recent_kernels() const;

  int ordinal_ = 0;
  void* handle_ = nullptr;
  bool owned_ = false;
  void* end_of_call_ = nullptr;  ///< a cudaEvent_t in the stream of the last CudaCall; null: there was none
  CudaActivity activity_;
  std::array<const char*, kRememberedKernels> kernels_{};  ///< launched since the last synchronisation, a ring
  std::size_t launches_ = 0;                               ///< ... their number
};

/// One call's work on a stream of a caller's, who may come with another one each time, and with another device current.
/// What the call gives to the stream starts when the work of the calls before is done, even if their stream is gone by
/// then; the host does not wait. The device is current until the call ends, then the one that was before.
class CudaCall {
 public:
  /// @param stream one that borrows a caller's
  /// Throws NoDeviceError where the machine has no such device.
  CudaCall(CudaStream& stream, void* handle);
  ~CudaCall();
  CudaCall(const CudaCall&) = delete;
  CudaCall& operator=(const CudaCall&) = delete;

 private:
  CudaStream& stream_;
  int device_before_ = 0;
};

}  // namespace splatboost
