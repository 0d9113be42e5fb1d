// SPDX-License-Identifier: Apache-2.0
#include "program/session/chosen_device.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

namespace splatboost::program {
namespace {

TEST(ChosenDevice, opencv_has_as_many_threads_but_no_more_than_cpus) {
  for (const int threads : {1, 0, kMaxThreads}) {
    const ChosenDevice device("cpu", threads);
    EXPECT_EQ(cv::getNumThreads(), threads == 1 ? 1 : available_cpus()) << threads;
  }
}

}  // namespace
}  // namespace splatboost::program
