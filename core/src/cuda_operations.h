// SPDX-License-Identifier: Apache-2.0
/// @file The operations on a CUDA device, as the public functions call them, which have checked the arguments. Each is
/// defined in the .cu file of its name; a build without CUDA has cuda_absent.cpp in their place.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "rasterizer_backend.h"
#include "splatboost/adam.h"
#include "splatboost/cuda_stream.h"
#include "splatboost/density_statistics.h"
#include "splatboost/device_array.h"
#include "splatboost/photometric.h"
#include "splatboost/random.h"
#include "splatboost/smoothing.h"
#include "splatboost/ssim.h"

namespace splatboost::cuda {

std::unique_ptr<RasterizerBackend> make_rasterizer(CudaStream& stream);

void exponentials(std::span<const float> from, std::span<float> to, CudaStream& stream);
void sigmoids(std::span<const float> from, std::span<float> to, CudaStream& stream);
void sigmoid_gradients(std::span<const float> sigmoids, std::span<float> gradients, CudaStream& stream);

/// As in elementwise.h.
void scale(std::span<float> values, float factor, CudaStream& stream);
void multiply(std::span<const float> values, std::span<const float> factors, std::span<float> products,
              CudaStream& stream);
void add_products(std::span<const float> values, std::span<const float> factors, std::span<float> sums,
                  CudaStream& stream);

/// @param kept factor of those that are not dropped
void dropout_factors(const RandomStream& random, double rate, float kept, std::span<float> factors, CudaStream& stream);

/// As in density_statistics.h.
void add_screen_gradients(const ScreenGradients& view, AbsoluteNorm norm, float views, const ScreenGradientSums& sums,
                          CudaStream& stream);
void mean_screen_gradients(const ScreenGradientSums& sums, std::span<float> means, std::span<float> means_abs,
                           CudaStream& stream);
void longest_scales(std::span<const float> scales, std::span<float> longest, CudaStream& stream);

/// As in smoothing.h. @param largest one number, workspace
void smoothing_filters(std::span<const float> means, std::span<const Camera> views, float deviation, float margin,
                       std::span<std::uint32_t> largest, std::span<float> filters, CudaStream& stream);
void smooth_gaussians(std::span<const float> scales, std::span<const float> opacities, std::span<const float> filters,
                      const SmoothedGaussians& smoothed, CudaStream& stream);
void smooth_gaussians_backward(std::span<const float> scales, std::span<const float> filters,
                               const SmoothedGaussians& smoothed, const SmoothedGradients& of_smoothed,
                               std::span<float> scale_gradients, std::span<float> opacity_gradients,
                               CudaStream& stream);

void adam_step(std::span<float> values, std::span<float> gradients, std::span<float> first_moments,
               std::span<float> second_moments, std::int64_t step, const AdamOptions& options, CudaStream& stream);

/// A loss as the device computes it.
struct LossTotals {
  double l1;            ///< Σ |difference|
  double ssim;          ///< Σ SSIM
  double counted;       ///< pixels
  double lambda_dssim;  ///< that the call was given
};

/// Losses on their way to the host, in the order of the calls.
class LossesOnTheWay {
 public:
  explicit LossesOnTheWay(CudaStream& stream);
  ~LossesOnTheWay();
  /// kMost are under way: the oldest must be waited for before another is sent.
  bool is_full() const;
  /// Starts the way of one. Does not wait.
  void send(const DeviceArray<double>& totals, float lambda_dssim);
  /// The oldest that was not taken yet, if it has arrived.
  std::optional<LossTotals> take();
  /// Waits for the oldest that was not taken yet; there must be one.
  LossTotals wait();

  static constexpr std::size_t kMost = 64;  ///< more iterations than the driver lets the host run ahead

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
  LossesOnTheWay losses;
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

/// As ScoreSums::add_view().
void add_view(std::span<const std::int32_t> view_counts, double photometric_loss, std::span<std::int64_t> counts,
              std::span<double> weighted_counts, CudaStream& stream);

/// As in scores.h.
void importance_scores(std::span<const std::int64_t> counts, int views, std::span<std::int64_t> scores,
                       CudaStream& stream);
void pruning_scores(std::span<const double> weighted_counts, std::span<float> scores, CudaStream& stream);

/// As in visibility.h.
void mark_visible(const Camera& camera, std::span<const float> means, float near_plane, std::span<std::uint8_t> visible,
                  CudaStream& stream);
void visible_radii(const Camera& camera, const Gaussians& gaussians, const RasterOptions& options,
                   std::span<std::int32_t> radii, CudaStream& stream);
/// Copies host memory to the device through pinned buffers, so that the host can go on.
class PinnedUploads {
 public:
  explicit PinnedUploads(CudaStream& stream);
  ~PinnedUploads();
  /// The two parts, one behind the other; what they are of may change as soon as this returns. Waits only if the device
  /// has not come to the upload before the last.
  void upload(std::span<const std::uint8_t> first, std::span<const std::uint8_t> second, std::uint8_t* to);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// As in rows.h; remove_rows() waits.
void remove_rows(DeviceArray<float>& tensor, std::size_t width, std::span<const std::uint8_t> removed);
/// Row i of `to` becomes row rows[i] of `from`.
void gather_rows(std::span<const float> from, std::size_t width, std::span<const std::uint32_t> rows,
                 std::span<float> to, CudaStream& stream);
void append_rows(DeviceArray<float>& tensor, std::size_t width, std::span<const std::uint32_t> rows);
void reorder_rows(DeviceArray<float>& tensor, std::size_t width, std::span<const std::uint32_t> order);

/// As in select.h.
std::size_t keep_important(std::span<const std::int64_t> importance, double threshold,
                           std::span<std::uint8_t> candidates, CudaStream& stream);
void keep_weighted_sample(std::span<const float> weights, std::size_t keep, const RandomStream& random,
                          std::span<std::uint8_t> candidates, CudaStream& stream);
void keep_largest(std::span<const float> priorities, std::size_t keep, std::span<std::uint8_t> candidates,
                  CudaStream& stream);
std::size_t spare_one(std::span<const float> priorities, std::span<std::uint8_t> removals, CudaStream& stream);

void spatial_order(std::span<const float> means, std::span<std::uint32_t> order, CudaStream& stream);

inline constexpr int kMostNeighbors = 8;  ///< a thread holds as many
void mean_squared_neighbor_distances(std::span<const float> points, int k, std::span<float> mean_squared_distances,
                                     CudaStream& stream);

}  // namespace splatboost::cuda
