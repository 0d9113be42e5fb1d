// SPDX-License-Identifier: Apache-2.0
/// @file The CPU time that control groups give this process (Linux: man 7 cgroups, man 5 proc).
#pragma once

#include <filesystem>
#include <optional>

namespace splatboost {

/// CPUs that the CPU quotas of this process's control groups allow, cgroup v1 and v2: the least of the quotas of its
/// group and of the groups above, as far as they are mounted. None without a quota. What cannot be read has no quota.
/// @param root where proc and sys are looked up: "/", or a made-up tree in tests
std::optional<double> cpu_quota(const std::filesystem::path& root);

/// CPUs to be used of those in the affinity mask: no more than the quota, rounded up; at least 1.
int cpus_within(int in_mask, std::optional<double> quota);

/// CPUs that the calling thread may run on, at least 1.
int cpus_in_affinity_mask();

}  // namespace splatboost
