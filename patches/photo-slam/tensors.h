// SPDX-License-Identifier: Apache-2.0
/// @file libtorch tensors as views of the C ABI of libsplatboost. Used by the files beside it, not by the host.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include <torch/torch.h>

#include "splatboost/c_api.h"

namespace splatboost {

using torch::Tensor;

/// Throws std::runtime_error with the library's message if a call failed.
inline void require(sb_status status) {
  if (status != SB_OK) throw std::runtime_error(std::string("SplatBoost: ") + sb_last_error());
}

inline sb_device device_of(const torch::Device& device) {
  sb_device given{};
  given.kind = device.is_cuda() ? SB_CUDA : SB_CPU;
  given.index = device.has_index() ? device.index() : 0;
  return given;
}

inline std::int32_t type_of(const Tensor& tensor) {
  if (tensor.scalar_type() == torch::kFloat) return SB_FLOAT32;
  if (tensor.scalar_type() == torch::kInt) return SB_INT32;
  if (tensor.scalar_type() == torch::kByte) return SB_UINT8;
  throw std::runtime_error("SplatBoost: a tensor of a type that the library has not");
}

/// A contiguous tensor and the library's view of it; converts to a null pointer if the tensor is undefined.
class Given {
 public:
  Given() = default;
  explicit Given(const Tensor& tensor) : tensor_(tensor.defined() ? tensor.detach().contiguous() : tensor) {
    if (!tensor_.defined()) return;
    const sb_device device = device_of(tensor_.device());
    view_.data = tensor_.data_ptr();
    view_.type = type_of(tensor_);
    view_.dimensions = static_cast<std::int32_t>(tensor_.dim());
    for (int i = 0; i < view_.dimensions; ++i) {
      view_.shape[i] = tensor_.size(i);
      view_.strides[i] = tensor_.stride(i);
    }
    view_.device_kind = device.kind;
    view_.device_index = device.index;
  }
  const Tensor& tensor() const { return tensor_; }
  operator const sb_tensor*() const { return tensor_.defined() ? &view_ : nullptr; }

 private:
  Tensor tensor_;
  sb_tensor view_{};
};

/// A tensor over the memory of a view from the library, without a copy: UINT8 as bytes, else int32.
inline Tensor tensor_of(const sb_tensor& view, const torch::Device& device) {
  const auto type = view.type == SB_UINT8 ? torch::kByte : torch::kInt;
  return torch::from_blob(view.data, std::vector<std::int64_t>(view.shape, view.shape + view.dimensions),
                          torch::TensorOptions().dtype(type).device(device));
}

}  // namespace splatboost
