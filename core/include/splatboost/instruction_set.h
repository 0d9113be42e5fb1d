// SPDX-License-Identifier: Apache-2.0
/// @file Which SIMD instructions the CPU operations use.
#pragma once

#include <string>

namespace splatboost {

enum class InstructionSet {
  best,      ///< the best that this machine has
  avx512,    ///< rows of 16 pixels
  avx2,      ///< rows of 8
  portable,  ///< rows of 4: what about every machine of an architecture has (SSE4 on x86-64, NEON on ARM)
};

/// Holds every operation to these instructions from now on, in the whole process; not while one runs. Throws
/// ArgumentError if the CPU does not support them. Results differ in the last bits from set to set; within one they are
/// the same bytes for any number of threads.
void use_instruction_set(InstructionSet set);

/// Name of the instructions in use, as Highway calls them: "AVX3_ZEN4", "AVX2", "SSE4" …
std::string instruction_set_name();

}  // namespace splatboost
