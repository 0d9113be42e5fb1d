// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cstring>
#include <utility>

#include "device/cuda_event.h"
#include "device/cuda_ops.h"

namespace splatboost::cuda {
namespace {

class PinnedBuffer {
 public:
  explicit PinnedBuffer(CudaStream& stream) : stream_(stream), read_(stream, cudaEventDisableTiming) {}
  ~PinnedBuffer() { stream_.release_pinned(memory_); }
  PinnedBuffer(const PinnedBuffer&) = delete;
  PinnedBuffer& operator=(const PinnedBuffer&) = delete;

  void send(std::span<const std::uint8_t> first, std::span<const std::uint8_t> second, std::uint8_t* to) {
    if (!read_.is_done()) read_.wait();
    const std::size_t bytes = first.size() + second.size();
    if (bytes > capacity_) {
      stream_.release_pinned(std::exchange(memory_, nullptr));
      capacity_ = 0;
      memory_ = static_cast<std::uint8_t*>(stream_.allocate_pinned(bytes));
      capacity_ = bytes;
    }
    if (!first.empty()) std::memcpy(memory_, first.data(), first.size());
    if (!second.empty()) std::memcpy(memory_ + first.size(), second.data(), second.size());
    stream_.copy_from_pinned(to, memory_, bytes);
    read_.record();
  }

 private:
  CudaStream& stream_;
  std::uint8_t* memory_ = nullptr;
  std::size_t capacity_ = 0;
  Event read_;  ///< the device has read the buffer
};

}  // namespace

struct PinnedUploads::State {
  explicit State(CudaStream& stream) : buffers{PinnedBuffer(stream), PinnedBuffer(stream)} {}
  PinnedBuffer buffers[2];
  std::size_t next = 0;
};

PinnedUploads::PinnedUploads(CudaStream& stream) : state_(std::make_unique<State>(stream)) {}
PinnedUploads::~PinnedUploads() = default;

void PinnedUploads::upload(std::span<const std::uint8_t> first, std::span<const std::uint8_t> second,
                           std::uint8_t* to) {
  state_->buffers[state_->next++ % 2].send(first, second, to);
}

}  // namespace splatboost::cuda
