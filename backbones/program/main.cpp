// SPDX-License-Identifier: Apache-2.0
#include "program/run_program.h"

int main(int argc, char** argv) { return splatboost::program::run_program(argc, argv); }
