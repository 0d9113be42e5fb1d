// SPDX-License-Identifier: Apache-2.0
/// @file Truth images in the memory of a device.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "splatboost/device.h"
#include "splatboost/photometric.h"

namespace splatboost {

/// On a GPU keeps the first images that fit a memory budget on the device, in 8 bit, and uploads the others on demand
/// through pinned memory, asynchronously to the host. On the CPU it uses the caller's images in place.
class TruthStore {
 public:
  /// @param images in host memory, which must outlive the store
  /// @param budget bytes of device memory for the images that are kept
  TruthStore(std::vector<TruthImage> images, std::size_t budget, Device device);
  ~TruthStore();
  TruthStore(TruthStore&&) noexcept;
  TruthStore& operator=(TruthStore&&) noexcept;

  /// @return the image in device memory, for work that is queued before the next call of get() or upload()
  TruthImage get(std::size_t image);
  /// The same for an image in host memory that is not in the store. It may change as soon as this returns.
  TruthImage upload(const TruthImage& image);
  /// Number of images that are kept on the device; on the CPU all.
  std::size_t kept() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost
