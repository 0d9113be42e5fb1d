// SPDX-License-Identifier: Apache-2.0
/// @file Which thread of a kernel runs now, and when: what tells accesses apart that come one after the other from
/// those that may meet. For the emulator's own files.
#pragma once

#include <cstdint>
#include <string>

namespace cuda_on_cpu {

/// Epochs count on over all grids and blocks, and one more at each barrier of a block: what is below `block` was
/// another block's, what is below `grid` another grid's.
struct Moment {
  std::uint64_t grid;   ///< the grid's first epoch
  std::uint64_t block;  ///< the block's
  std::uint64_t now;
  std::uint64_t warp_now;  ///< counts on at each __syncwarp of all lanes
  int thread;              ///< in the block
};

bool is_in_kernel();
/// Of a thread of a kernel; there must be one.
Moment moment();
/// Ends the kernel with a Fault. In a kernel it does not return; the stack of the thread is left as it is, so it may be
/// called from where an exception must not pass. In other work of a stream it returns: that ends with the fault.
void end_with_fault(const std::string& what);
/// Throws the fault that other work than a kernel ended with.
void throw_fault_of_work();

}  // namespace cuda_on_cpu
