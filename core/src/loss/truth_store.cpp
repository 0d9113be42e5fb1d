// SPDX-License-Identifier: Apache-2.0
#include "splatboost/truth_store.h"

#include <algorithm>
#include <optional>

#include "device/cuda_ops.h"
#include "splatboost/device_array.h"
#include "splatboost/errors.h"

namespace splatboost {
namespace {

std::size_t bytes_of(const TruthImage& image) { return image.color.size() + image.valid.size(); }

/// A view of the image whose pixels are stored at `at`, followed by its mask.
TruthImage image_at(const TruthImage& image, const std::uint8_t* at) {
  return {image.width, image.height, {at, image.color.size()}, {at + image.color.size(), image.valid.size()}};
}

struct OnCuda {
  explicit OnCuda(CudaStream& stream) : kept(stream), uploaded(stream), uploads(stream) {}
  DeviceArray<std::uint8_t> kept;      ///< the first images, contiguous
  std::vector<std::size_t> places;     ///< offset of each of them in kept
  DeviceArray<std::uint8_t> uploaded;  ///< the image requested last that is not kept
  cuda::PinnedUploads uploads;
};

}  // namespace

struct TruthStore::State {
  std::vector<TruthImage> images;
  std::optional<OnCuda> cuda;
};

TruthStore::TruthStore(std::vector<TruthImage> images, std::size_t budget, Device device)
    : state_(std::make_unique<State>()) {
  State& s = *state_;
  s.images = std::move(images);
  if (!device.is_cuda()) return;
  OnCuda& cuda = s.cuda.emplace(device.stream());
  std::size_t bytes = 0;
  for (const TruthImage& image : s.images) {
    if (bytes + bytes_of(image) > budget) break;
    cuda.places.push_back(bytes);
    bytes += bytes_of(image);
  }
  cuda.kept.ensure(bytes);
  for (std::size_t i = 0; i < cuda.places.size(); ++i) {
    cuda.uploads.upload(s.images[i].color, s.images[i].valid, cuda.kept.data() + cuda.places[i]);
  }
  std::size_t largest = 0;
  for (std::size_t i = cuda.places.size(); i < s.images.size(); ++i) largest = std::max(largest, bytes_of(s.images[i]));
  cuda.uploaded.ensure(largest);
}

TruthStore::~TruthStore() = default;
TruthStore::TruthStore(TruthStore&&) noexcept = default;
TruthStore& TruthStore::operator=(TruthStore&&) noexcept = default;

TruthImage TruthStore::get(std::size_t image) {
  State& s = *state_;
  SPLATBOOST_CHECK(image < s.images.size(), "there is no such image");
  const TruthImage& truth = s.images[image];
  if (!s.cuda) return truth;
  if (image < s.cuda->places.size()) return image_at(truth, s.cuda->kept.data() + s.cuda->places[image]);
  return upload(truth);
}

TruthImage TruthStore::upload(const TruthImage& image) {
  if (!state_->cuda) return image;
  OnCuda& cuda = *state_->cuda;
  // The previous image may be overwritten: its readers come earlier in the stream.
  cuda.uploaded.ensure(bytes_of(image));
  cuda.uploads.upload(image.color, image.valid, cuda.uploaded.data());
  return image_at(image, cuda.uploaded.data());
}

std::size_t TruthStore::kept() const { return state_->cuda ? state_->cuda->places.size() : state_->images.size(); }

}  // namespace splatboost
