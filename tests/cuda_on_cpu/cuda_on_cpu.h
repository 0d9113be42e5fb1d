// SPDX-License-Identifier: Apache-2.0
/// @file Runs CUDA kernels on the CPU, so that they are tested where there is no GPU.
///
/// The .cu files are compiled as C++ with this folder's cuda_runtime.h and cub/ in place of the toolkit's. A launch
/// is work for its stream, as a copy is: a stream does nothing before the host waits for it, the slowest that a device
/// can be, so that what the host does too early shows. A grid runs block by block; the threads of a block are fibers of
/// the host's one thread. Faults are thrown where the host waits: an access out of bounds, a race or an unwritten value
/// in shared memory or in the device's, a barrier or a warp function that some threads never reach, a lane mask that is
/// not of those that arrive. Code of the host that touches memory of the device ends with a segmentation fault, at that
/// line.
///
/// What it cannot see: orders of execution other than those it is told to run, and how hardware rounds to the last bit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <stdexcept>

namespace cuda_on_cpu {

/// What a kernel did wrong, with the kernel's block and thread.
class Fault : public std::logic_error {
 public:
  using std::logic_error::logic_error;
};

/// Runs blocks, and a block's threads between two barriers, in an order drawn from this seed, another one at each
/// launch; 0: in their own order. 1 unless told. What a kernel computes may depend on it only where atomic additions of
/// floats do.
void permute(std::uint64_t seed);

/// The most pieces of work (launches, copies, marks of events) that wait in a stream; 0: each is done when it is given,
/// and a fault is thrown there, as where CUDA_LAUNCH_BLOCKING=1 is set. Any number at first.
/// @return what it was
std::size_t set_lag(std::size_t pieces);

/// Size of the memory of the device. Allocations beyond it fail.
void set_device_memory(std::size_t bytes);

/// Bytes that are allocated on the device.
std::size_t device_memory_in_use();

/// Number of devices that the runtime finds: 1 unless changed.
void set_device_count(int count);

/// Whether all work that `earlier` was given so far is done, on a GPU too, before what `later` is given next: they are
/// one stream, or `later` waits for an event. @param earlier,later each a cudaStream_t
bool comes_after(void* later, void* earlier);

}  // namespace cuda_on_cpu
