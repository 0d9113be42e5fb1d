// SPDX-License-Identifier: Apache-2.0
#include "trainer/support/process_info.h"

#include <unistd.h>

#include <algorithm>
#include <ctime>
#include <fstream>
#include <limits>
#include <sstream>

namespace splatboost {
namespace {

/// The number after `key` in a file of "key number" lines; 0 if there is none.
std::uint64_t find_number(const char* file, const std::string& key) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (!line.starts_with(key)) continue;
    std::istringstream fields(line.substr(key.size()));
    std::uint64_t number = 0;
    fields >> number;
    return number;
  }
  return 0;
}

/// Bytes left below the memory limit of the control group (version 2; containers set it); without a limit: the maximum.
std::uint64_t control_group_room() {
  constexpr std::uint64_t kNone = std::numeric_limits<std::uint64_t>::max();
  std::uint64_t limit = 0, used = 0;
  std::ifstream("/sys/fs/cgroup/memory.max") >> limit;  // "max" (no limit) does not parse: 0
  std::ifstream("/sys/fs/cgroup/memory.current") >> used;
  if (limit == 0) return kNone;
  // The kernel drops cached files when memory is needed.
  used -= std::min(used, find_number("/sys/fs/cgroup/memory.stat", "inactive_file "));
  return limit - std::min(limit, used);
}

}  // namespace

std::uint64_t resident_memory_bytes() { return 1024 * find_number("/proc/self/status", "VmRSS:"); }

std::uint64_t free_memory_bytes() {
  return std::min(1024 * find_number("/proc/meminfo", "MemAvailable:"), control_group_room());
}

std::uint64_t peak_memory_bytes() { return 1024 * find_number("/proc/self/status", "VmHWM:"); }

bool reset_peak_memory() {
  // Linux: 5 sets VmHWM to the memory in use now (proc(5), /proc/pid/clear_refs).
  std::ofstream clear("/proc/self/clear_refs");
  return static_cast<bool>(clear << "5" << std::flush);
}

std::string machine_name() {
  std::ifstream cpuinfo("/proc/cpuinfo");
  for (std::string line; std::getline(cpuinfo, line);) {
    const std::size_t colon = line.find(':');
    if (!line.starts_with("model name") || colon == std::string::npos) continue;
    const std::size_t begin = line.find_first_not_of(" \t", colon + 1);
    if (begin != std::string::npos) return line.substr(begin);
  }
  return "unknown processor";
}

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text;
}

}  // namespace splatboost
