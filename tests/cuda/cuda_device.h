// SPDX-License-Identifier: Apache-2.0
/// @file The device of a CUDA test: a GPU, or the emulator that runs kernels on the CPU.
#pragma once

#include <gtest/gtest.h>

#include <memory>

#include "splatboost/cuda_stream.h"
#include "splatboost/errors.h"

namespace splatboost::test {

/// Base of tests that are skipped where there is no device.
template <class Base = ::testing::Test>
class OnCuda : public Base {
 protected:
  void SetUp() override {
    try {
      stream_ = std::make_unique<CudaStream>();
    } catch (const NoDeviceError& error) {
      GTEST_SKIP() << error.what();
    }
  }
  CudaStream& stream() { return *stream_; }

 private:
  std::unique_ptr<CudaStream> stream_;
};

}  // namespace splatboost::test
