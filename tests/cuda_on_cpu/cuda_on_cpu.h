// SPDX-License-Identifier: Apache-2.0
/// @file Runs CUDA kernels on the CPU, so that they can be tested without a GPU.
///
/// The .cu files are compiled as C++ with this folder's cuda_runtime.h and cub/ in place of the toolkit's. Launches and
/// copies are queued in their stream, and a stream executes nothing until the host waits for it (the slowest possible
/// device), so that tests fail if the host uses a result too early. A grid runs block by block; the threads of a block
/// are fibers of the single host thread. Faults are thrown where the host waits: an access out of bounds, a race or a
/// read of an unwritten value in shared or global memory, a barrier or a warp function that some threads never reach, a
/// lane mask that does not match the lanes that arrive. Host code that touches device memory ends with a segmentation
/// fault at that line.
///
/// Not detected: faults in orders of execution that are not run, and rounding differences of real hardware.
#pragma once

#include <cstddef>
#include <cstdint>
#include <stdexcept>

namespace cuda_on_cpu {

/// A fault of a kernel. The message names the block and the thread.
class Fault : public std::logic_error {
 public:
  using std::logic_error::logic_error;
};

/// Runs the blocks, and a block's threads between two barriers, in an order drawn from this seed, a new one at each
/// launch; 0: in order of their indices. Default 1. Results of a kernel may depend on the order only through atomic
/// additions of floats.
void permute(std::uint64_t seed);

/// Sets the maximum number of operations (launches, copies, event records) that wait in a stream; 0: each is executed
/// in the call that queues it, and faults are thrown there, as with CUDA_LAUNCH_BLOCKING=1. Unlimited by default.
/// @return the previous value
std::size_t set_lag(std::size_t pieces);

/// Sets the size of device memory. Allocations beyond it fail.
void set_device_memory(std::size_t bytes);

/// Number of bytes currently allocated on the device.
std::size_t device_memory_in_use();

/// Sets the number of devices that the runtime reports; 1 by default.
void set_device_count(int count);

/// Whether all work queued in `earlier` so far is ordered before what is queued in `later` next, on a GPU too: they are
/// the same stream, or `later` waits for an event of it. @param later,earlier each a cudaStream_t
bool comes_after(void* later, void* earlier);

}  // namespace cuda_on_cpu
