// SPDX-License-Identifier: Apache-2.0
#include "device/cpu_quota.h"

#include <sched.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace splatboost {
namespace {

namespace fs = std::filesystem;

/// Whether "cpu" is in a list such as "rw,cpu,cpuacct".
bool lists_cpu(std::string_view list) {
  while (!list.empty()) {
    const std::string_view word = list.substr(0, list.find(','));
    if (word == "cpu") return true;
    list.remove_prefix(std::min(list.size(), word.size() + 1));
  }
  return false;
}

/// Decodes the octal escapes that mountinfo uses in paths: a space is \040.
std::string unescaped(const std::string& text) {
  const auto octal = [](char c) { return c >= '0' && c <= '7'; };
  std::string plain;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '\\' && i + 3 < text.size() && octal(text[i + 1]) && octal(text[i + 2]) && octal(text[i + 3])) {
      plain += static_cast<char>((text[i + 1] - '0') * 64 + (text[i + 2] - '0') * 8 + (text[i + 3] - '0'));
      i += 3;
    } else {
      plain += text[i];
    }
  }
  return plain;
}

/// The group of this process in the cgroup v2 hierarchy, or in the v1 hierarchy of the cpu controller.
std::optional<std::string> own_group(const fs::path& root, bool v2) {
  std::ifstream file(root / "proc/self/cgroup");
  for (std::string line; std::getline(file, line);) {  // number:controllers:path
    const std::size_t first = line.find(':');
    const std::size_t second = first == std::string::npos ? first : line.find(':', first + 1);
    if (second == std::string::npos) continue;
    const std::string_view controllers = std::string_view(line).substr(first + 1, second - first - 1);
    if (v2 ? controllers.empty() : lists_cpu(controllers)) return line.substr(second + 1);
  }
  return std::nullopt;
}

struct Mount {
  std::string group;  ///< group that is mounted: the root of the hierarchy, or a group below it
  std::string point;
};

std::vector<Mount> mounts(const fs::path& root, bool v2) {
  std::vector<Mount> found;
  std::ifstream file(root / "proc/self/mountinfo");
  for (std::string line; std::getline(file, line);) {
    const std::size_t dash = line.find(" - ");
    if (dash == std::string::npos) continue;
    std::istringstream before(line.substr(0, dash)), after(line.substr(dash + 3));
    std::string number, parent, device, group, point, type, source, options;
    before >> number >> parent >> device >> group >> point;
    after >> type >> source >> options;
    if (v2 ? type == "cgroup2" : type == "cgroup" && lists_cpu(options)) {
      found.push_back({unescaped(group), unescaped(point)});
    }
  }
  return found;
}

/// CPUs that the files of one group allow.
std::optional<double> quota_of(const fs::path& folder, bool v2) {
  std::string quota, period;
  if (v2) {
    std::ifstream(folder / "cpu.max") >> quota >> period;
  } else {
    std::ifstream(folder / "cpu.cfs_quota_us") >> quota;
    std::ifstream(folder / "cpu.cfs_period_us") >> period;
  }
  // Anything but a number above 0 ("max", -1, no file) means that there is no quota.
  const double time = std::atof(quota.c_str()), of = std::atof(period.c_str());
  if (time > 0 && of > 0) return time / of;
  return std::nullopt;
}

std::optional<double> least(std::optional<double> a, std::optional<double> b) {
  if (a && b) return std::min(a, b);
  return a ? a : b;
}

std::optional<double> quota_in(const fs::path& root, bool v2) {
  const std::optional<std::string> group = own_group(root, v2);
  if (!group) return std::nullopt;
  std::optional<double> found;
  for (const Mount& mount : mounts(root, v2)) {
    // A container may see the hierarchy only from its own group downwards, while the group's path is that of the host.
    const std::string above = mount.group == "/" ? "" : mount.group;
    const bool inside = *group == above || group->starts_with(above + "/");
    fs::path below = inside ? fs::path(group->substr(above.size())).relative_path().lexically_normal() : fs::path();
    if (!below.empty() && *below.begin() == "..") below.clear();
    const fs::path top = root / fs::path(mount.point).relative_path();
    for (; !below.empty(); below = below.parent_path()) found = least(found, quota_of(top / below, v2));
    found = least(found, quota_of(top, v2));
  }
  return found;
}

}  // namespace

std::optional<double> cpu_quota(const fs::path& root) { return least(quota_in(root, true), quota_in(root, false)); }

int cpus_within(int in_mask, std::optional<double> quota) {
  if (!quota) return std::max(1, in_mask);
  return static_cast<int>(std::clamp(std::ceil(*quota), 1.0, static_cast<double>(std::max(1, in_mask))));
}

int cpus_in_affinity_mask() {
  // The kernel rejects a mask that is smaller than its own with EINVAL.
  for (std::size_t sets = 1; sets <= 64; sets *= 2) {
    std::vector<cpu_set_t> mask(sets);
    if (sched_getaffinity(0, sets * sizeof(cpu_set_t), mask.data()) == 0) {
      return std::max(1, CPU_COUNT_S(sets * sizeof(cpu_set_t), mask.data()));
    }
    if (errno != EINVAL) break;
  }
  return static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
}

}  // namespace splatboost
