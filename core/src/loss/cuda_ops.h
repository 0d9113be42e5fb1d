// SPDX-License-Identifier: Apache-2.0
/// @file The operations of this folder on a CUDA device, as the public functions call them, which have checked the
/// arguments. Each is defined in the .cu file of its name; a build without CUDA has cuda_absent.cpp in their place.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "splatboost/cuda_stream.h"
#include "splatboost/device_array.h"
#include "splatboost/photometric.h"
#include "splatboost/ssim.h"

namespace splatboost::cuda {

/// A loss as the device computes it.
struct LossTotals {
  double l1;            ///< Σ |difference|
  double ssim;          ///< Σ SSIM
  double counted;       ///< pixels
  double lambda_dssim;  ///< that the call was given
};

/// Losses on their way to the host, in the order of the calls.
class PendingLosses {
 public:
  explicit PendingLosses(CudaStream& stream);
  ~PendingLosses();
  /// kCapacity are under way: the oldest must be waited for before another is sent.
  bool is_full() const;
  /// Starts the way of one. Does not wait.
  void send(const DeviceArray<double>& totals, float lambda_dssim);
  /// The oldest that was not taken yet, if it has arrived.
  std::optional<LossTotals> take();
  /// Waits for the oldest that was not taken yet; there must be one.
  LossTotals wait();

  static constexpr std::size_t kCapacity = 64;  ///< more iterations than the driver lets the host run ahead

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// What the loss keeps from call to call.
struct PhotometricWorkspace {
  explicit PhotometricWorkspace(CudaStream& stream)
      : derivatives(stream), sums(stream), totals(stream), losses(stream) {}

  DeviceArray<float> derivatives;  ///< [3,3,H,W] of SSIM by means, squares and products
  DeviceArray<double> sums;        ///< of each tile
  DeviceArray<double> totals;
  PendingLosses losses;
};

/// Sends the loss on its way. Does not wait.
void photometric(std::span<const float> render, const TruthImage& truth, float lambda_dssim, std::span<float> gradient,
                 PhotometricWorkspace& workspace, CudaStream& stream);

/// As splatboost::ssim(). @param border pixels at the planes' edges without a window
void ssim(const SsimPlanes& planes, std::span<const float> images, std::span<const float> truths, int border,
          std::span<float> gradient, std::span<double> mean, CudaSsimWorkspace& workspace);

struct ErrorCounts {
  std::size_t flagged = 0;
  std::size_t valid = 0;
  std::size_t covered = 0;  ///< valid, with an error above `no_error`
};

/// As splatboost::flag_errors(). Waits.
ErrorCounts flag_errors(std::span<const float> render, const TruthImage& truth, float tau, float no_error,
                        std::span<float> error, std::span<std::uint8_t> flagged, CudaStream& stream);

}  // namespace splatboost::cuda
