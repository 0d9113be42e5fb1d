// SPDX-License-Identifier: Apache-2.0
#include "splatboost/threads.h"

#include <algorithm>
#include <thread>

#include "splatboost/errors.h"

namespace splatboost {

Threads::Threads(int count) : count_(count) {
  SPLATBOOST_CHECK(count >= 0, "the number of threads must not be negative");
  if (count == 0) count_ = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
}

void Threads::run(std::size_t n, std::size_t grain, const void* context, Piece piece) {
  const std::size_t pieces = (n + grain - 1) / grain;
  const auto run_piece = [&](std::size_t i) { piece(context, i * grain, std::min(n, (i + 1) * grain)); };
  // Not an if clause: OpenMP's runtime allocates a team for a parallel region of one thread, each time.
  if (pieces <= 1 || count_ == 1) {
    for (std::size_t i = 0; i < pieces; ++i) run_piece(i);
    return;
  }
  // A thread takes the next piece when it is done with one: pieces differ in work.
#pragma omp parallel for schedule(dynamic, 1) num_threads(count_)
  for (std::size_t i = 0; i < pieces; ++i) run_piece(i);
}

}  // namespace splatboost
