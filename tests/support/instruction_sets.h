// SPDX-License-Identifier: Apache-2.0
/// @file Runs a test with every instruction set that this machine has.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <string>

#include <hwy/targets.h>

namespace splatboost::test {

/// Enables all instruction sets again on destruction.
struct RestoreTargets {
  ~RestoreTargets() { hwy::SetSupportedTargetsForTest(0); }
};

/// Calls body once for each instruction set, with dispatch restricted to it.
template <class Body>
void for_each_target(const Body& body) {
  const RestoreTargets restore;
  int number = 0;
  for (std::uint64_t left = static_cast<std::uint64_t>(hwy::SupportedTargets()); left != 0; left &= left - 1) {
    const auto target = static_cast<std::int64_t>(left & (~left + 1));
    hwy::SetSupportedTargetsForTest(target);
    SCOPED_TRACE(std::string("instruction set ") + hwy::TargetName(target));
    body();
    ++number;
  }
  EXPECT_GE(number, 1);
}

}  // namespace splatboost::test
