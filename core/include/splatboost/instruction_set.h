// SPDX-License-Identifier: Apache-2.0
/// @file Which SIMD instructions the CPU operations use.
#pragma once

#include <string>

namespace splatboost {

enum class InstructionSet {
  best,      ///< the best that this machine has
  avx512,    ///< rows of 16 pixels
  avx2,      ///< rows of 8
  portable,  ///< rows of 4: available on nearly every machine of an architecture (SSE4 on x86-64, NEON on ARM)
};

/// Restricts every operation of the process to these instructions from now on. Do not call it while an operation runs.
/// Throws ArgumentError if the CPU does not support them. Results differ in the last bits between instruction sets;
/// within one they are bitwise the same for any number of threads.
void use_instruction_set(InstructionSet set);

/// Name of the instructions in use, as Highway calls them: "AVX3_ZEN4", "AVX2", "SSE4" …
std::string instruction_set_name();

}  // namespace splatboost
