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

/// Vectors of 128 bits. Where there are none of these, plain C++ stands in.
constexpr std::int64_t k128 = HWY_SSE4 | HWY_SSSE3 | HWY_NEON | HWY_WASM;

/// Compiled and supported; the lowest bit is the best.
std::int64_t usable() { return static_cast<std::int64_t>(hwy::SupportedTargets()) & HWY_TARGETS; }

/// The best of those in use, 0 until first asked for. Kept, because asking the processor takes microseconds, and in a
/// virtual machine tens of them.
std::atomic<std::int64_t> best_target{0};

void find_best_target() {
  const std::int64_t targets = usable();
  best_target = targets & -targets;
}

}  // namespace

void use_instruction_set(InstructionSet set) {
  hwy::SetSupportedTargetsForTest(0);  // 0: all that there are
  find_best_target();
  if (set == InstructionSet::best) return;
  const std::int64_t wanted = set == InstructionSet::avx512 ? kAvx512
                              : set == InstructionSet::avx2 ? HWY_AVX2
                              : (usable() & k128) != 0      ? k128
                                                            : HWY_STATIC_TARGET;
  const std::int64_t held = usable() & wanted;
  SPLATBOOST_CHECK(held != 0, "this machine or build has not these instructions");
  hwy::SetSupportedTargetsForTest(held);
  find_best_target();
}

std::string instruction_set_name() {
  if (best_target == 0) find_best_target();
  return hwy::TargetName(best_target);
}

}  // namespace splatboost
