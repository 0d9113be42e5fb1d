// SPDX-License-Identifier: Apache-2.0
/// @file The net of deep_net.h on a CUDA device: cuBLAS for the products over all rows, kernels for the rest. For .cu
/// files.
#pragma once

#include <span>

#include "families/nets/deep_net.h"
#include "families/nets/matrices_cuda.h"
#include "splatboost/device_array.h"

namespace splatboost::cuda {

/// Spans are in device memory; shapes as in deep_net.h.
class CudaDeepNet {
 public:
  /// @param matrices on the same stream; must outlive this object
  CudaDeepNet(const DeepNetShape& shape, CudaStream& stream, CudaMatrices& matrices)
      : shape_(shape),
        stream_(stream),
        matrices_(matrices),
        biases_(stream),
        values_(stream),
        gradients_(stream),
        bias_gradients_(stream) {}

  /// @param x [rows,inputs] @param keep whether backward() follows
  void forward(std::span<const float> parameters, std::span<const float> shared, std::size_t rows,
               std::span<const float> x, std::span<float> y, bool keep);
  /// Backward pass of the last forward(), which must have had `keep`.
  void backward(std::span<const float> parameters, std::span<const float> shared, std::span<const float> x,
                std::span<const float> y_gradient, std::span<float> parameter_gradients,
                std::span<float> shared_gradient);

 private:
  DeepNetShape shape_;
  CudaStream& stream_;
  CudaMatrices& matrices_;
  std::size_t rows_ = 0;
  DeviceArray<float> biases_;          ///< [layers,hidden] including the products of the shared inputs
  DeviceArray<float> values_;          ///< [layers,rows,hidden]; [2,rows,hidden] in turn without `keep`
  DeviceArray<float> gradients_;       ///< [2,rows,hidden]
  DeviceArray<float> bias_gradients_;  ///< [layers · hidden + outputs] of the current call
};

}  // namespace splatboost::cuda
