// SPDX-License-Identifier: Apache-2.0
/// @file A stream of a CUDA device: every CUDA operation takes one, and only it allocates device memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

namespace splatboost {

/// Counts of events that must not happen in the training loop: tests check that they stay 0.
struct CudaActivity {
  std::uint64_t allocations = 0;       ///< of device memory and of pinned host memory
  std::uint64_t synchronizations = 0;  ///< times that the host waited for the device
};

/// Number of CUDA devices on this machine; 0 without a driver and in a build without CUDA.
int cuda_device_count() noexcept;

/// Compute capabilities that the .cu files were compiled for, such as "7.5, 9.0"; empty in a build without CUDA.
const char* cuda_architectures() noexcept;

/// Owns a stream, or borrows the caller's stream (CudaCall). Queued work runs in order, asynchronously to the
/// host. Not thread-safe.
///
/// A build without CUDA has this class too; its constructor throws NoDeviceError. A failed kernel is reported by the
/// next call that checks the device, as a DeviceError that names the possible kernels: those launched since the last
/// synchronisation, or only the failed one if CUDA_LAUNCH_BLOCKING=1 is set.
class CudaStream {
 public:
  /// Throws NoDeviceError if the machine has no device of that number.
  explicit CudaStream(int ordinal = 0);
  /// Borrows a stream that the caller owns. Makes no CUDA call.
  /// @param handle cudaStream_t; nullptr is the device's default stream
  CudaStream(int ordinal, void* handle) : ordinal_(ordinal), handle_(handle) {}
  ~CudaStream();
  CudaStream(const CudaStream&) = delete;
  CudaStream& operator=(const CudaStream&) = delete;

  int ordinal() const { return ordinal_; }
  std::string device_name() const;
  /// Bytes of free device memory.
  std::size_t free_memory() const;
  /// The cudaStream_t.
  void* handle() const { return handle_; }
  /// Waits for all work queued so far.
  void synchronize();
  const CudaActivity& activity() const { return activity_; }
  /// Sums over all streams since the process began.
  static CudaActivity total_activity() noexcept;

  // Memory, in bytes. Prefer DeviceArray, which owns its memory.
  /// Throws DeviceMemoryError if memory runs out.
  void* allocate(std::size_t bytes);
  void release(void* memory) noexcept;
  /// Pinned host memory, which asynchronous copies need. Throws DeviceError if it runs out.
  void* allocate_pinned(std::size_t bytes);
  void release_pinned(void* memory) noexcept;
  /// `from` need not be pinned, and may then change as soon as this returns: the driver may wait for earlier work,
  /// which is not counted. Do not call it in the training loop.
  void copy_to_device(void* to, const void* from, std::size_t bytes);
  /// Does not wait; `from` must be pinned.
  void copy_from_pinned(void* to, const void* from, std::size_t bytes);
  void copy_on_device(void* to, const void* from, std::size_t bytes);
  /// Waits until the copy is done.
  void copy_to_host(void* to, const void* from, std::size_t bytes);
  /// Does not wait; `to` must be pinned.
  void copy_to_pinned(void* to, const void* from, std::size_t bytes);
  void fill_zero(void* memory, std::size_t bytes);

  /// Makes the device the calling thread's current device.
  void make_current() const;
  /// Makes the device current and records the name of a kernel that is about to be launched, for error messages.
  /// @param kernel a string literal
  void begin_launch(const char* kernel);
  /// Throws if the launch failed. @param error the launch's cudaError_t
  void end_launch(int error);
  /// Number of kernels launched so far.
  std::size_t launches() const { return launches_; }
  /// Counts a wait that happened elsewhere. @param launches number of kernels launched before what was waited for
  void count_synchronization(std::size_t launches);
  /// Throws DeviceError, or DeviceMemoryError, unless `error` is cudaSuccess. @param error a cudaError_t
  void check(int error, const char* what) const;

 private:
  friend class CudaCall;
  static constexpr std::size_t kRememberedKernels = 32;
  void count_allocation();
  std::string recent_kernels() const;

  int ordinal_ = 0;
  void* handle_ = nullptr;
  bool owned_ = false;
  void* end_of_call_ = nullptr;  ///< cudaEvent_t at the end of the last CudaCall; null: none yet
  CudaActivity activity_;
  std::array<const char*, kRememberedKernels> kernels_{};  ///< ring buffer of the last launches
  std::size_t launches_ = 0;
  std::size_t finished_ = 0;  ///< number of launches that the host has waited for
};

/// Scope of one call on the caller's stream, which may differ from call to call, as may the current device. The work of
/// this call starts after that of earlier calls, even if their streams have been destroyed; the host does not wait. The
/// device is current until the scope ends; then the previous one is restored.
class CudaCall {
 public:
  /// Throws NoDeviceError if the machine has no such device.
  /// @param stream a borrowing one
  /// @param handle the caller's cudaStream_t for this call
  CudaCall(CudaStream& stream, void* handle);
  ~CudaCall();
  CudaCall(const CudaCall&) = delete;
  CudaCall& operator=(const CudaCall&) = delete;

 private:
  CudaStream& stream_;
  int device_before_ = 0;
};

}  // namespace splatboost
