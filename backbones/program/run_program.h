// SPDX-License-Identifier: Apache-2.0
/// @file The splatboost program without main(). It uses the backbones that the executable links.
#pragma once

namespace splatboost::program {

/// @return the exit status: 0, 1 (failure), 2 (bad input or usage), or 128 + N when interrupted by signal N
int run_program(int argc, char** argv);

}  // namespace splatboost::program
