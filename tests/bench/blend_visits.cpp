// SPDX-License-Identifier: Apache-2.0
// How often a GPU's warps blend a splat in the bench's scenes, as JSON: with 8 × 4 pixels per warp, and with 8 × 8.
// scripts/cuda_instructions runs it.
#include <iostream>

#include "program/bench/blend_work.h"
#include "splatboost/threads.h"

int main() {
  using namespace splatboost;
  Threads threads;
  const char* separator = "{";
  for (const BenchSize& size : bench_sizes()) {
    const BenchScene bench = make_bench_scene(size);
    std::cout << separator << '"' << size.name << "\": ["
              << program::count_blend_work(bench, program::kInstructionPixels, threads).cells << ", "
              << program::count_blend_work(bench, program::kWarpPixels, threads).cells << ']';
    separator = ", ";
  }
  std::cout << "}\n";
}
