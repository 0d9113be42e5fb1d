// SPDX-License-Identifier: Apache-2.0
/// @file Which thread of a kernel is running, and its logical time, by which ordered accesses are distinguished from
/// concurrent ones. Internal to the emulator.
#pragma once

#include <cstdint>
#include <string>

namespace cuda_on_cpu {

/// Logical time of a thread. Epochs increase over all grids and blocks and at each barrier of a block: an epoch below
/// `block` belongs to another block, one below `grid` to an earlier grid.
struct Moment {
  std::uint64_t grid;   ///< first epoch of the grid
  std::uint64_t block;  ///< first epoch of the block
  std::uint64_t now;
  std::uint64_t warp_now;  ///< incremented at each __syncwarp of all lanes
  int thread;              ///< index in the block
};

bool is_in_kernel();
/// Time of the running thread. Requires is_in_kernel().
Moment moment();
/// Ends the running work with a Fault. In a kernel it does not return and does not unwind the thread's stack, so it may
/// be called where exceptions must not propagate. In other work of a stream it returns; the work ends with the fault.
void end_with_fault(const std::string& what);
/// Throws the fault of work other than a kernel, if there is one.
void throw_fault_of_work();

}  // namespace cuda_on_cpu
