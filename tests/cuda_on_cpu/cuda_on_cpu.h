// SPDX-License-Identifier: Apache-2.0
/// @file Runs CUDA kernels on the CPU, so that they are tested where there is no GPU.
///
/// The .cu files are compiled as C++ with this folder's cuda_runtime.h and cub/ in place of the toolkit's. A launch
/// runs its grid block by block and returns when it is done; the threads of a block are fibers of the one thread that
/// launches. Faults are thrown by the launch: an access out of bounds, a race or an unwritten value in shared memory,
/// a barrier or a warp function that some threads never reach, a lane mask that is not of those that arrive. Code of
/// the host that touches memory of the device ends with a segmentation fault, at that line.
///
/// What it cannot see: races in global memory, and orders of execution other than those it is told to run.
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

/// Runs blocks, and a block's threads between two barriers, in an order drawn from this seed; 0: in their own order.
/// What a kernel computes may depend on it only where atomic additions of floats do.
void permute(std::uint64_t seed);

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
