// SPDX-License-Identifier: Apache-2.0
/// @file What the library throws, and the check that throws it.
#pragma once

#include <stdexcept>
#include <string>

namespace splatboost {

/// An argument breaks a documented contract (shape, range, finiteness). Names the expression and the reason.
class ArgumentError : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

/// What a GPU or its driver reports: a kernel that failed, a call that did.
class DeviceError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The device that was asked for cannot be used at all: there is none, or the build has no CUDA.
class NoDeviceError : public DeviceError {
 public:
  using DeviceError::DeviceError;
};

/// The device has too little memory left. Says how many bytes were wanted and had.
class DeviceMemoryError : public DeviceError {
 public:
  using DeviceError::DeviceError;
};

[[noreturn]] inline void throw_argument_error(const char* expression, const std::string& reason) {
  throw ArgumentError(reason + " (" + expression + " is false)");
}

}  // namespace splatboost

/// Checks a contract at the edge of the library; kernels check nothing.
#define SPLATBOOST_CHECK(expression, reason)                                    \
  do {                                                                          \
    if (!(expression)) ::splatboost::throw_argument_error(#expression, reason); \
  } while (false)
