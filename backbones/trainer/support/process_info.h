// SPDX-License-Identifier: Apache-2.0
/// @file Memory use of this process, name of the machine and current time.
#pragma once

#include <cstdint>
#include <string>

namespace splatboost {

/// Resident memory of this process; 0 if unknown.
std::uint64_t resident_memory_bytes();
/// Memory that this process can still allocate without swapping, within the limit of its control group if there is one;
/// 0 if unknown.
std::uint64_t free_memory_bytes();
/// Peak resident memory of this process since its start or the last reset; 0 if unknown.
std::uint64_t peak_memory_bytes();
/// Resets the peak, so that the second run of a comparison does not inherit the first one's. False if not possible.
bool reset_peak_memory();
/// Name of the processor, for reports.
std::string machine_name();
/// Current time, as 2026-01-31T12:00:00Z.
std::string utc_now();

}  // namespace splatboost
