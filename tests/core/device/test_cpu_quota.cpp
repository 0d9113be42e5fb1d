// SPDX-License-Identifier: Apache-2.0
// CPU quotas of control groups, read from fake /proc and /sys trees.
#include "device/cpu_quota.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <string>

namespace splatboost::test {
namespace {

class CpuQuota : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (std::filesystem::temp_directory_path() / "splatboost-test-XXXXXX").string();
    ASSERT_NE(mkdtemp(pattern.data()), nullptr);
    root_ = pattern;
  }
  void TearDown() override { std::filesystem::remove_all(root_); }
  void write(const std::string& path, const std::string& text) const {
    std::filesystem::create_directories((root_ / path).parent_path());
    std::ofstream(root_ / path) << text << '\n';
  }
  std::optional<double> quota() const { return cpu_quota(root_); }

 private:
  std::filesystem::path root_;
};

constexpr const char* kMountV2 = "30 23 0:26 / /sys/fs/cgroup rw,nosuid shared:4 - cgroup2 cgroup2 rw,nsdelegate";
constexpr const char* kMountV1 =
    "22 1 0:21 / /proc rw - proc proc rw\n"
    "36 31 0:33 / /sys/fs/cgroup/cpu,cpuacct rw,relatime - cgroup cgroup rw,cpu,cpuacct\n"
    "37 31 0:34 / /sys/fs/cgroup/cpuset rw,relatime - cgroup cgroup rw,cpuset";

TEST_F(CpuQuota, IsNoneWithoutControlGroups) {
  EXPECT_EQ(quota(), std::nullopt);
  write("proc/self/cgroup", "0::/");
  EXPECT_EQ(quota(), std::nullopt);
  write("proc/self/mountinfo", kMountV2);
  EXPECT_EQ(quota(), std::nullopt);  // the top group has no cpu.max
  write("proc/self/cgroup", "nonsense\n0:\n:::");
  write("proc/self/mountinfo", "nonsense\n - \n1 2 - cgroup2");
  EXPECT_EQ(quota(), std::nullopt);
}

TEST_F(CpuQuota, OfVersion2IsTheLeastOnTheWayUp) {
  write("proc/self/cgroup", "0::/user.slice/job/step");
  write("proc/self/mountinfo", kMountV2);
  write("sys/fs/cgroup/user.slice/job/step/cpu.max", "max 100000");
  EXPECT_EQ(quota(), std::nullopt);
  write("sys/fs/cgroup/user.slice/cpu.max", "400000 100000");
  EXPECT_EQ(quota(), 4.0);
  write("sys/fs/cgroup/user.slice/job/cpu.max", "75000 50000");
  EXPECT_EQ(quota(), 1.5);
  write("sys/fs/cgroup/user.slice/job/step/cpu.max", "200000 100000");
  EXPECT_EQ(quota(), 1.5);
  write("sys/fs/cgroup/user.slice/other/cpu.max", "10000 100000");  // not this process's group
  EXPECT_EQ(quota(), 1.5);
  write("sys/fs/cgroup/user.slice/job/step/cpu.max", "20000 100000");
  EXPECT_EQ(quota(), 0.2);
}

TEST_F(CpuQuota, OfVersion1IsTheLeastOnTheWayUp) {
  write("proc/self/cgroup", "4:cpuset:/elsewhere\n3:cpu,cpuacct:/docker/abc\n1:name=systemd:/docker/abc");
  write("proc/self/mountinfo", kMountV1);
  write("sys/fs/cgroup/cpu,cpuacct/docker/abc/cpu.cfs_quota_us", "-1");
  write("sys/fs/cgroup/cpu,cpuacct/docker/abc/cpu.cfs_period_us", "100000");
  EXPECT_EQ(quota(), std::nullopt);
  write("sys/fs/cgroup/cpu,cpuacct/docker/cpu.cfs_quota_us", "250000");
  EXPECT_EQ(quota(), std::nullopt);  // the period is missing
  write("sys/fs/cgroup/cpu,cpuacct/docker/cpu.cfs_period_us", "100000");
  EXPECT_EQ(quota(), 2.5);
  write("sys/fs/cgroup/cpu,cpuacct/docker/abc/cpu.cfs_quota_us", "50000");
  EXPECT_EQ(quota(), 0.5);
}

TEST_F(CpuQuota, IsTheLeastOfBothVersions) {
  write("proc/self/cgroup", "3:cpu,cpuacct:/a\n0::/b");
  write("proc/self/mountinfo",
        std::string(kMountV1) + "\n40 31 0:38 / /sys/fs/cgroup/unified rw,relatime - cgroup2 cgroup2 rw");
  write("sys/fs/cgroup/unified/b/cpu.max", "300000 100000");
  EXPECT_EQ(quota(), 3.0);
  write("sys/fs/cgroup/cpu,cpuacct/a/cpu.cfs_quota_us", "200000");
  write("sys/fs/cgroup/cpu,cpuacct/a/cpu.cfs_period_us", "100000");
  EXPECT_EQ(quota(), 2.0);
  write("sys/fs/cgroup/unified/b/cpu.max", "100000 100000");
  EXPECT_EQ(quota(), 1.0);
}

TEST_F(CpuQuota, IsFoundWhereAContainerSeesItsOwnGroupAsTheTop) {
  // Docker with cgroup v1: paths are the host's, and the mount shows the container's group.
  write("proc/self/cgroup", "3:cpu,cpuacct:/docker/abc/inner");
  write("proc/self/mountinfo", "36 31 0:33 /docker/abc /sys/fs/cgroup/cpu ro - cgroup cgroup rw,cpu,cpuacct");
  write("sys/fs/cgroup/cpu/cpu.cfs_quota_us", "150000");
  write("sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000");
  EXPECT_EQ(quota(), 1.5);
  write("sys/fs/cgroup/cpu/inner/cpu.cfs_quota_us", "100000");
  write("sys/fs/cgroup/cpu/inner/cpu.cfs_period_us", "100000");
  EXPECT_EQ(quota(), 1.0);
  // The group lies outside of the mounted hierarchy: the quota of its root counts.
  for (const char* group : {"/docker/abcd", "/../sibling", "/"}) {
    write("proc/self/cgroup", std::string("3:cpu,cpuacct:") + group);
    EXPECT_EQ(quota(), 1.5) << group;
  }
}

TEST_F(CpuQuota, IsFoundInAMountWhosePathHasBlanks) {
  write("proc/self/cgroup", "0::/a b");
  write("proc/self/mountinfo", "30 23 0:26 / /sys/my\\040groups rw - cgroup2 cgroup2 rw");
  write("sys/my groups/a b/cpu.max", "100000 50000");
  EXPECT_EQ(quota(), 2.0);
}

TEST(CpusWithin, RoundsTheQuotaUpAndStaysInTheMask) {
  EXPECT_EQ(cpus_within(8, std::nullopt), 8);
  EXPECT_EQ(cpus_within(8, 0.2), 1);
  EXPECT_EQ(cpus_within(8, 1.0), 1);
  EXPECT_EQ(cpus_within(8, 1.5), 2);
  EXPECT_EQ(cpus_within(8, 64.0), 8);
  EXPECT_EQ(cpus_within(8, 1e30), 8);
  EXPECT_EQ(cpus_within(0, 2.0), 1);
}

}  // namespace
}  // namespace splatboost::test
