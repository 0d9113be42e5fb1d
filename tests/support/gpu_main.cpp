// SPDX-License-Identifier: Apache-2.0
// main() of tests that need a GPU: returns 77, which ctest reports as skipped, if there is no GPU and nothing failed.
#include <gtest/gtest.h>

#include "splatboost/cuda_stream.h"

int main(int count, char** arguments) {
  ::testing::InitGoogleTest(&count, arguments);
  const int result = RUN_ALL_TESTS();
  return result == 0 && splatboost::cuda_device_count() == 0 ? 77 : result;
}
