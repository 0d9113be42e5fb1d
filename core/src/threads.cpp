// SPDX-License-Identifier: Apache-2.0
#include "splatboost/threads.h"

#include <algorithm>
#include <thread>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>
#include <oneapi/tbb/task_arena.h>

#include "splatboost/errors.h"

namespace splatboost {

struct Threads::Arena {
  explicit Arena(int count)
      : parallelism(tbb::global_control::max_allowed_parallelism, std::max(count, 1)), arena(count) {}
  // TBB caps its workers at the hardware's threads unless told otherwise; more than that serves tests only.
  tbb::global_control parallelism;
  tbb::task_arena arena;
};

Threads::Threads(int count) {
  SPLATBOOST_CHECK(count >= 0, "the number of threads must not be negative");
  if (count == 0) count = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  arena_ = std::make_unique<Arena>(count);
}

Threads::~Threads() = default;

int Threads::count() const { return arena_->arena.max_concurrency(); }

void Threads::run(std::size_t n, std::size_t grain, const void* context, Piece piece) {
  if (n == 0) return;
  const std::size_t pieces = (n + grain - 1) / grain;
  const auto run_pieces = [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) piece(context, i * grain, std::min(n, (i + 1) * grain));
  };
  if (pieces == 1 || count() == 1) {
    run_pieces(0, pieces);
    return;
  }
  arena_->arena.execute([&] {
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, pieces, 1),
        [&](const tbb::blocked_range<std::size_t>& range) { run_pieces(range.begin(), range.end()); },
        tbb::auto_partitioner());
  });
}

}  // namespace splatboost
