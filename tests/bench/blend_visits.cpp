// SPDX-License-Identifier: Apache-2.0
// How often a GPU's warps blend a splat in the bench's scenes, as JSON: by 8 × 4 pixels a warp, and by 8 × 8.
// scripts/cuda_instructions runs it.
#include <iostream>

#include "cli/blend_work.h"
#include "splatboost/threads.h"

int main() {
  using namespace splatboost;
  Threads threads;
  const char* separator = "{";
  for (const BenchSize& size : bench_sizes()) {
    const BenchScene bench = make_bench_scene(size);
    std::cout << separator << '"' << size.name << "\": ["
              << cli::count_blend_work(bench, cli::kInstructionPixels, threads).cells << ", "
              << cli::count_blend_work(bench, cli::kWarpPixels, threads).cells << ']';
    separator = ", ";
  }
  std::cout << "}\n";
}
