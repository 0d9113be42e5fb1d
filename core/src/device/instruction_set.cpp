// SPDX-License-Identifier: Apache-2.0
#include "splatboost/instruction_set.h"

#include <atomic>
#include <cstdint>

#include <hwy/highway.h>
#include <hwy/targets.h>

#include "splatboost/errors.h"

namespace splatboost {
namespace {

constexpr std::int64_t kAvx512 = HWY_AVX3 | HWY_AVX3_DL
#ifdef HWY_AVX3_ZEN4  // Highway 1.0.4 and later
                                 | HWY_AVX3_ZEN4 | HWY_AVX3_SPR
#endif
    ;

/// Targets with 128-bit vectors. Without any of them the portable set is the static target.
constexpr std::int64_t k128 = HWY_SSE4 | HWY_SSSE3 | HWY_NEON | HWY_WASM;

/// Targets that are compiled in and that the CPU supports; the lowest bit is the best.
std::int64_t usable() { return static_cast<std::int64_t>(hwy::SupportedTargets()) & HWY_TARGETS; }

/// The best target in use, 0 until first needed. Cached, because querying the processor takes microseconds, in a
/// virtual machine tens of microseconds.
std::atomic<std::int64_t> best_target{0};

void find_best_target() {
  const std::int64_t targets = usable();
  best_target = targets & -targets;
}

}  // namespace

void use_instruction_set(InstructionSet set) {
  static std::int64_t restriction = 0;  // 0: none
  hwy::SetSupportedTargetsForTest(0);
  const std::int64_t wanted = set == InstructionSet::avx512 ? kAvx512
                              : set == InstructionSet::avx2 ? HWY_AVX2
                              : (usable() & k128) != 0      ? k128
                                                            : HWY_STATIC_TARGET;
  const std::int64_t held = usable() & wanted;
  const bool supported = set == InstructionSet::best || held != 0;
  if (supported) restriction = set == InstructionSet::best ? 0 : held;
  hwy::SetSupportedTargetsForTest(restriction);
  find_best_target();
  SPLATBOOST_CHECK(supported, "this machine or build does not support these instructions");
}

std::string instruction_set_name() {
  if (best_target == 0) find_best_target();
  return hwy::TargetName(best_target);
}

}  // namespace splatboost
