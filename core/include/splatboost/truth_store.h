// SPDX-License-Identifier: Apache-2.0
/// @file Truth images where the operations of a device can read them.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "splatboost/device.h"
#include "splatboost/photometric.h"

namespace splatboost {

/// On a GPU keeps as many images as a budget holds, 8 bit as they are, and uploads the others when they are asked for,
/// through pinned memory: the host goes on. On the CPU images are where they are.
class TruthStore {
 public:
  /// @param images of the host, which must outlive this
  /// @param budget bytes of the device's memory
  TruthStore(std::vector<TruthImage> images, std::size_t budget, Device device);
  ~TruthStore();
  TruthStore(TruthStore&&) noexcept;
  TruthStore& operator=(TruthStore&&) noexcept;

  /// @return in the device's memory, for work that is given to it before the next call
  TruthImage get(std::size_t image);
  /// Images that are kept there.
  std::size_t kept() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace splatboost
