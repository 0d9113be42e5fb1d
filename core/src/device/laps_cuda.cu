// SPDX-License-Identifier: Apache-2.0
#include <array>

#include "device/cuda_event.h"
#include "splatboost/cuda_laps.h"

namespace splatboost {
namespace {
constexpr std::size_t kCapacity = 1024;  // most marks whose laps are not yet taken
}

struct CudaLaps::State {
  struct Mark {
    explicit Mark(CudaStream& stream) : event(stream, cudaEventDefault) {}
    cuda::Event event;
    const char* stage = nullptr;
  };
  explicit State(CudaStream& on) : stream(on) {}
  std::unique_ptr<Mark>& at(std::size_t number) { return marks[number % kCapacity]; }

  CudaStream& stream;
  std::array<std::unique_ptr<Mark>, kCapacity> marks;  ///< ring buffer, created on first use
  std::size_t set = 0;                                 ///< number of marks so far
  std::size_t taken = 0;                               ///< index of the mark that begins the next lap
};

CudaLaps::CudaLaps(CudaStream& stream) : state_(std::make_unique<State>(stream)) {}
CudaLaps::~CudaLaps() = default;
CudaLaps::CudaLaps(CudaLaps&&) noexcept = default;
CudaLaps& CudaLaps::operator=(CudaLaps&&) noexcept = default;

void CudaLaps::mark(const char* stage) {
  State& s = *state_;
  if (s.set - s.taken >= kCapacity - 1) {  // full, because laps are not taken: drop the oldest
    s.at(s.taken)->event.wait();
    ++s.taken;
  }
  std::unique_ptr<State::Mark>& mark = s.at(s.set);
  if (mark == nullptr) mark = std::make_unique<State::Mark>(s.stream);
  mark->stage = stage;
  mark->event.record();
  ++s.set;
}

std::optional<CudaLaps::Lap> CudaLaps::take() {
  State& s = *state_;
  while (s.taken + 1 < s.set) {
    const State::Mark &from = *s.at(s.taken), &to = *s.at(s.taken + 1);
    if (!to.event.is_done()) return std::nullopt;
    ++s.taken;
    if (to.stage != nullptr) return Lap{to.stage, seconds_between(from.event, to.event)};
  }
  return std::nullopt;
}

}  // namespace splatboost
