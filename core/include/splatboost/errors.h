// SPDX-License-Identifier: Apache-2.0
/// @file Exceptions of the library, and the check that throws ArgumentError.
#pragma once

#include <stdexcept>
#include <string>

namespace splatboost {

/// An argument violates a documented requirement (shape, range, finiteness). Names the expression and the reason.
class ArgumentError : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

/// An error that a GPU or its driver reports: a kernel or a CUDA call failed.
class DeviceError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The requested device cannot be used at all: it does not exist, or the build has no CUDA.
class NoDeviceError : public DeviceError {
 public:
  using DeviceError::DeviceError;
};

/// The device has too little free memory. The message gives the requested and the free bytes.
class DeviceMemoryError : public DeviceError {
 public:
  using DeviceError::DeviceError;
};

[[noreturn]] inline void throw_argument_error(const char* expression, const std::string& reason) {
  throw ArgumentError(reason + " (" + expression + " is false)");
}

}  // namespace splatboost

/// Checks an argument at the interface of the library; kernels check nothing.
#define SPLATBOOST_CHECK(expression, reason)                                    \
  do {                                                                          \
    if (!(expression)) ::splatboost::throw_argument_error(#expression, reason); \
  } while (false)
