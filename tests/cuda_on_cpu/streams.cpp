// SPDX-License-Identifier: Apache-2.0
// Streams and events. Work stays queued until the host waits for it, or until the queue exceeds the allowed lag.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <exception>
#include <limits>
#include <map>
#include <memory>

#include "cuda_runtime.h"
#include "grid.h"

struct CudaOnCpuStream {};

namespace {

/// For each stream the number of its operations that are ordered before the next one of this stream (or event).
using Progress = std::map<cudaStream_t, std::uint64_t>;

struct Stream {
  std::deque<std::function<void()>> work;
  Progress progress;
};

/// Position of an event in a stream.
struct Mark {
  cudaStream_t stream;
  Progress progress;
  bool reached = false;
  std::chrono::steady_clock::time_point at{};
};

std::map<cudaStream_t, Stream>& streams() {
  static auto& all =
      *new std::map<cudaStream_t, Stream>;  // never destroyed, because static objects may free memory after that
  return all;
}

/// Maximum number of operations that wait in a stream.
std::size_t& lag() {
  static std::size_t pieces = [] {
    const char* const blocking = std::getenv("CUDA_LAUNCH_BLOCKING");
    return blocking != nullptr && *blocking == '1' ? 0 : std::numeric_limits<std::size_t>::max();
  }();
  return pieces;
}

/// A fault of work that was executed in a call that must not throw; the next call that may throw rethrows it.
struct Failure {
  std::exception_ptr fault;
  ~Failure() {
    if (!fault) return;
    std::fputs("a kernel failed, and nobody looked at the device after it\n", stderr);
    std::abort();
  }
  void rethrow() {
    if (fault) std::rethrow_exception(std::exchange(fault, nullptr));
  }
} failure;

void do_next(Stream& stream) {
  const std::function<void()> work = std::move(stream.work.front());
  stream.work.pop_front();
  try {
    work();
    cuda_on_cpu::throw_fault_of_work();
  } catch (...) {
    for (auto& [handle, other] : streams()) other.work.clear();  // a device executes nothing more after a fault
    throw;
  }
}

void do_all_but(std::size_t pieces, Stream& stream) {
  if (stream.work.size() <= pieces) return;
  const cuda_on_cpu::DeviceAccess access;  // once, rather than per operation
  while (stream.work.size() > pieces) do_next(stream);
}

void finish(Stream& stream) { do_all_but(0, stream); }

void append(Stream& stream, std::function<void()> work) {
  failure.rethrow();
  stream.work.push_back(std::move(work));
  do_all_but(lag(), stream);
}

/// For calls made by destructors: keeps a fault for the next call that may throw.
template <class Call>
void quietly(const Call& call) noexcept {
  try {
    call();
  } catch (...) {
    failure.fault = std::current_exception();
  }
}

void finish(Mark& mark) {
  Stream& stream = streams()[mark.stream];
  const cuda_on_cpu::DeviceAccess access;
  while (!mark.reached && !stream.work.empty()) do_next(stream);
}

}  // namespace

struct CudaOnCpuEvent {
  std::shared_ptr<Mark> mark;  ///< null: never recorded
};

namespace cuda_on_cpu {

void give_work(cudaStream_t stream, std::function<void()> work) {
  Stream& to = streams()[stream];
  ++to.progress[stream];
  append(to, std::move(work));
}

void finish_everything() noexcept {
  quietly([] {
    for (auto& [handle, stream] : streams()) finish(stream);
  });
}

std::size_t set_lag(std::size_t pieces) {
  for (auto& [handle, stream] : streams()) do_all_but(pieces, stream);
  return std::exchange(lag(), pieces);
}

bool comes_after(void* later, void* earlier) {
  const auto from = static_cast<cudaStream_t>(earlier);
  return streams()[static_cast<cudaStream_t>(later)].progress[from] >= streams()[from].progress[from];
}

}  // namespace cuda_on_cpu

cudaError_t cudaStreamCreateWithFlags(cudaStream_t* stream, unsigned) {
  *stream = new CudaOnCpuStream;
  return cudaSuccess;
}

cudaError_t cudaStreamDestroy(cudaStream_t stream) {
  cuda_on_cpu::finish_everything();
  delete stream;
  return cudaSuccess;
}

cudaError_t cudaStreamSynchronize(cudaStream_t stream) {
  failure.rethrow();
  finish(streams()[stream]);
  return cudaSuccess;
}

cudaError_t cudaMemcpyAsync(void* to, const void* from, std::size_t bytes, cudaMemcpyKind kind, cudaStream_t stream) {
  const bool from_pageable = kind == cudaMemcpyHostToDevice && cuda_on_cpu::is_pageable(from);
  std::shared_ptr<std::byte[]> staged;  // pageable memory is read before the call returns
  if (from_pageable) {
    staged.reset(new std::byte[bytes]);
    const cuda_on_cpu::DeviceAccess access;  // `from` may be device memory in tests of callers' kernels
    std::memcpy(staged.get(), from, bytes);
  }
  cuda_on_cpu::give_work(stream, [=] {
    const cuda_on_cpu::DeviceAccess access;
    cuda_on_cpu::note_read(from, bytes);
    std::memmove(to, staged ? staged.get() : from, bytes);
    cuda_on_cpu::note_written(to, bytes);
  });
  // Pageable memory is also written before the call returns.
  if (kind == cudaMemcpyDeviceToHost && cuda_on_cpu::is_pageable(to)) return cudaStreamSynchronize(stream);
  return cudaSuccess;
}

cudaError_t cudaMemsetAsync(void* memory, int byte, std::size_t bytes, cudaStream_t stream) {
  cuda_on_cpu::give_work(stream, [=] {
    const cuda_on_cpu::DeviceAccess access;
    std::memset(memory, byte, bytes);
    cuda_on_cpu::note_written(memory, bytes);
  });
  return cudaSuccess;
}

cudaError_t cudaEventCreateWithFlags(cudaEvent_t* event, unsigned) {
  *event = new CudaOnCpuEvent;
  return cudaSuccess;
}

cudaError_t cudaEventDestroy(cudaEvent_t event) {
  delete event;
  return cudaSuccess;
}

cudaError_t cudaEventRecord(cudaEvent_t event, cudaStream_t stream) {
  Stream& in = streams()[stream];
  event->mark = std::make_shared<Mark>(Mark{stream, in.progress});
  quietly([&] {
    append(in, [mark = event->mark] {
      mark->reached = true;
      mark->at = std::chrono::steady_clock::now();
    });
  });
  return cudaSuccess;
}

cudaError_t cudaEventQuery(cudaEvent_t event) {
  failure.rethrow();
  return event->mark == nullptr || event->mark->reached ? cudaSuccess : cudaErrorNotReady;
}

cudaError_t cudaEventSynchronize(cudaEvent_t event) {
  failure.rethrow();
  if (event->mark != nullptr) finish(*event->mark);
  return cudaSuccess;
}

cudaError_t cudaEventElapsedTime(float* milliseconds, cudaEvent_t from, cudaEvent_t to) {
  if (from->mark == nullptr || to->mark == nullptr) return cudaErrorInvalidValue;
  if (!from->mark->reached || !to->mark->reached) return cudaErrorNotReady;
  *milliseconds = std::chrono::duration<float, std::milli>(to->mark->at - from->mark->at).count();
  return cudaSuccess;
}

cudaError_t cudaStreamWaitEvent(cudaStream_t handle, cudaEvent_t event, unsigned) {
  if (event->mark == nullptr) return cudaSuccess;
  Stream& stream = streams()[handle];
  for (const auto& [other, pieces] : event->mark->progress) {
    stream.progress[other] = std::max(stream.progress[other], pieces);
  }
  append(stream, [mark = event->mark] { finish(*mark); });
  return cudaSuccess;
}
