// SPDX-License-Identifier: Apache-2.0
// One iteration of a small fixed scene for scripts/instruction_counts to run under callgrind, on one thread. What runs
// before it, the scene and a warm-up that grows all workspaces, is not counted.
//
// usage: splatboost_counted_iteration avx2|portable
#include <cstdio>
#include <string>

#include <valgrind/callgrind.h>

#include "bench/workload.h"
#include "splatboost/errors.h"
#include "splatboost/instruction_set.h"

int main(int argc, char** argv) {
  using namespace splatboost;
  const std::string set = argc == 2 ? argv[1] : "";
  if (set != "avx2" && set != "portable") {
    std::fprintf(stderr, "usage: %s avx2|portable\n", argv[0]);
    return 2;
  }
  try {
    use_instruction_set(set == "avx2" ? InstructionSet::avx2 : InstructionSet::portable);
  } catch (const ArgumentError& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
  // The density of the 60k scene of `splatboost bench`, in an image that callgrind processes in seconds.
  const BenchSize size{"small", 1500, 96, 80};
  Threads threads(1);
  test::Workload work(size, threads);
  work.iteration();
  CALLGRIND_START_INSTRUMENTATION;
  work.iteration();
  CALLGRIND_STOP_INSTRUMENTATION;
  std::printf("{\"compiler\": \"%s\", \"splats\": %zu, \"width\": %d, \"height\": %d}\n", SPLATBOOST_COMPILER,
              size.splats, size.width, size.height);
  return 0;
}
