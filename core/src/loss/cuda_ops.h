// SPDX-License-Identifier: Apache-2.0
/// @file CUDA implementations of this folder's operations, called by the public functions, which check the arguments.
/// Each is defined in the .cu file of its name; a build without CUDA compiles cuda_absent.cpp instead.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "splatboost/cuda_stream.h"
#include "splatboost/device_array.h"
#include "splatboost/error_map.h"
#include "splatboost/photometric.h"
#include "splatboost/ssim.h"

namespace splatboost::cuda {

/// Sums of a loss, as computed on the device.
struct LossTotals {
  double l1;            ///< Σ |difference|
  double ssim;          ///< Σ SSIM
  double counted;       ///< number of valid pixels
  double lambda_dssim;  ///< as passed to the call
};

/// Losses being copied to the host, in the order of the calls.
class PendingLosses {
 public:
  explicit PendingLosses(CudaStream& stream);
  ~PendingLosses();
  /// kCapacity losses are pending: wait() for the oldest is required before the next send().
  bool is_full() const;
  /// Starts copying a loss. Does not wait.
  void send(const DeviceArray<double>& totals, float lambda_dssim);
  /// Takes the oldest pending loss, if it has arrived.
  std::optional<LossTotals> take();
  /// Waits for the oldest pending loss and takes it; there must be one.
  LossTotals wait();

  static constexpr std::size_t kCapacity = 64;  ///< more iterations than the driver lets the host run ahead

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Workspace of the loss, kept between calls.
struct PhotometricWorkspace {
  explicit PhotometricWorkspace(CudaStream& stream)
      : derivatives(stream), sums(stream), totals(stream), losses(stream) {}

  DeviceArray<float> derivatives;  ///< [3,3,H,W] of SSIM with respect to means, squares and products
  DeviceArray<double> sums;        ///< per tile
  DeviceArray<double> totals;
  PendingLosses losses;
};

/// Enqueues the loss and its gradient, and sends the loss to workspace.losses. Does not wait.
void photometric(std::span<const float> render, const TruthImage& truth, float lambda_dssim, std::span<float> gradient,
                 PhotometricWorkspace& workspace, CudaStream& stream);

/// As splatboost::ssim(). @param border width of the planes' margin without windows, px
void ssim(const SsimPlanes& planes, std::span<const float> images, std::span<const float> truths, int border,
          std::span<float> gradient, std::span<double> mean, CudaSsimWorkspace& workspace);

/// As splatboost::flag_errors(). Waits for the device.
ErrorCounts flag_errors(std::span<const float> render, const TruthImage& truth, float tau, std::span<float> error,
                        std::span<std::uint8_t> flagged, CudaStream& stream);

}  // namespace splatboost::cuda
