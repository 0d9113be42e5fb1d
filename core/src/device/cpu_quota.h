// SPDX-License-Identifier: Apache-2.0
/// @file The CPU time that control groups give this process (Linux: man 7 cgroups, man 5 proc).
#pragma once

#include <filesystem>
#include <optional>

namespace splatboost {

/// Number of CPUs that the quotas of this process's control groups (cgroup v1 and v2) allow: the smallest quota of its
/// group and of the mounted groups above. No value if there is no quota. Groups that cannot be read have no quota.
/// @param root directory that holds proc and sys: "/", or a fake tree in tests
std::optional<double> cpu_quota(const std::filesystem::path& root);

/// Number of CPUs to use: those in the affinity mask, but at most the quota, rounded up; at least 1.
int cpus_within(int in_mask, std::optional<double> quota);

/// Number of CPUs that the calling thread may run on, at least 1.
int cpus_in_affinity_mask();

}  // namespace splatboost
