// SPDX-License-Identifier: Apache-2.0
#include "program/session/chosen_device.h"

#include <charconv>
#include <optional>
#include <string_view>

#include "program/session/run_options.h"
#include "splatboost/errors.h"
#include "splatboost/threads.h"
#include "trainer/images/image_codec.h"

namespace splatboost::program {
namespace {

/// The index of the GPU of "cuda" and "cuda:N"; none: another name.
std::optional<int> ordinal_of(const std::string& name) {
  if (name == "cuda") return 0;
  constexpr std::string_view kPrefix = "cuda:";
  if (!name.starts_with(kPrefix)) return std::nullopt;
  int ordinal = -1;
  const char* const end = name.data() + name.size();
  const auto parsed = std::from_chars(name.data() + kPrefix.size(), end, ordinal);
  return parsed.ec == std::errc{} && parsed.ptr == end && ordinal >= 0 ? std::optional(ordinal) : std::nullopt;
}

}  // namespace

bool is_device_name(const std::string& name) { return name == "cpu" || ordinal_of(name); }

void check_device_name(const std::string& name) {
  if (!is_device_name(name)) throw UsageError("--device " + std::string(kDeviceRule) + ", not '" + name + "'");
}

std::string threads_rule() { return "must be 0 to " + std::to_string(kMaxThreads); }

bool is_thread_count(int threads) { return threads >= 0 && threads <= kMaxThreads; }

void check_threads(int threads) {
  if (!is_thread_count(threads)) throw UsageError("--threads " + threads_rule());
}

ChosenDevice::ChosenDevice(const std::string& name, int threads) : threads_(threads) {
  set_opencv_threads(threads_.count());
  check_device_name(name);
  const std::optional<int> ordinal = ordinal_of(name);
  if (!ordinal) return;
  try {
    stream_ = std::make_unique<CudaStream>(*ordinal);
  } catch (const NoDeviceError& error) {
    throw InputError("--device " + name + ": " + error.what() + "; use --device cpu to run without a GPU");
  }
}

}  // namespace splatboost::program
