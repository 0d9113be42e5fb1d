// SPDX-License-Identifier: Apache-2.0
/// @file What the system says of this process, this machine and the time.
#pragma once

#include <cstdint>
#include <string>

namespace splatboost {

/// Resident memory of this process; 0 where the system does not tell.
std::uint64_t resident_memory_bytes();
/// Memory that this process can still get without swapping: the machine's, or less where its control group has a
/// limit; 0 where the system does not tell.
std::uint64_t free_memory_bytes();
/// Peak resident memory of this process since its start or the last reset; 0 where the system does not tell.
std::uint64_t peak_memory_bytes();
/// Starts a new peak, so that the second run of a comparison does not inherit the first one's. False if not possible.
bool reset_peak_memory();
/// Name of the processor, for reports.
std::string machine_name();
/// Now, as 2026-01-31T12:00:00Z.
std::string utc_now();

}  // namespace splatboost
