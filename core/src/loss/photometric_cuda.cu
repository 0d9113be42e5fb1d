// SPDX-License-Identifier: Apache-2.0
// The loss in three kernels: SSIM's values and derivatives of each tile of pixels; the sums of the tiles; the gradient,
// which blurs the derivatives once more (the window is its own adjoint).
#include <array>

#include "device/readbacks.h"
#include "loss/cuda_ops.h"
#include "loss/ssim_cuda.h"

namespace splatboost::cuda {
namespace {

constexpr int kTotals = 3;  // Σ |difference|, Σ SSIM, counted pixels

__global__ void __launch_bounds__(kSsimThreads)
    similarity_kernel(ImageSize size, DeviceView<const float> render, DeviceView<const std::uint8_t> truth,
                      DeviceView<const std::uint8_t> valid, DeviceView<float> derivatives, DeviceView<double> sums) {
  __shared__ TilePixels renders, truths;
  __shared__ TileRows rows[4];
  __shared__ SharedArray<float, kTotals * kSsimThreads / 32> warps;
  const SsimTilePixel pixel;
  const std::size_t pixels = size.pixels(), channel = blockIdx.z;

  // Zero outside the image; where a pixel is not valid, render = truth.
  for_tile_pixels([&](int k, int x, int y) {
    float a = 0, b = 0;
    if (size.holds(x, y)) {
      const std::size_t p = size.at(x, y);
      b = static_cast<float>(truth[channel * pixels + p]) * (1.0f / 255.0f);
      a = valid.empty() || valid[p] != 0 ? render[channel * pixels + p] : b;
    }
    renders.set(k, a);
    truths.set(k, b);
  });
  __syncthreads();
  const SsimPixel<float> s = ssim_of_tile(renders, truths, rows, pixel);
  const bool inside = size.holds(pixel.x, pixel.y);
  const std::size_t p = inside ? size.at(pixel.x, pixel.y) : 0;
  const bool counts = inside && (valid.empty() || valid[p] != 0);
  if (inside && !derivatives.empty()) {
    const std::size_t at = channel * pixels + p;
    derivatives[at] = counts ? s.d_mean : 0.0f;
    derivatives[3 * pixels + at] = counts ? s.d_square : 0.0f;
    derivatives[6 * pixels + at] = counts ? s.d_product : 0.0f;
  }
  const int middle = (pixel.row + kSsimRadius) * kSsimSide + pixel.column + kSsimRadius;
  const float parts[kTotals] = {counts ? fabsf(renders.get(middle) - truths.get(middle)) : 0.0f,
                                counts ? s.value : 0.0f, counts && channel == 0 ? 1.0f : 0.0f};
  const double sum = block_sum(parts, warps);
  if (threadIdx.x < kTotals) sums[kTotals * block_number() + threadIdx.x] = sum;
}

__global__ void __launch_bounds__(kSsimThreads)
    gradient_kernel(ImageSize size, DeviceView<const float> render, DeviceView<const std::uint8_t> truth,
                    DeviceView<const std::uint8_t> valid, DeviceView<const float> derivatives,
                    DeviceView<const double> totals, float lambda_dssim, DeviceView<float> gradient) {
  __shared__ TileDerivatives tile;
  __shared__ SharedArray<float, 2> weights;  // of L1 and of SSIM
  const SsimTilePixel pixel;
  const std::size_t pixels = size.pixels(), channel = blockIdx.z;
  float sums[3];
  tile.blur(
      pixel,
      [&](std::size_t q, int x, int y) {
        return size.holds(x, y) ? derivatives[(3 * q + channel) * pixels + size.at(x, y)] : 0.0f;
      },
      sums);
  if (threadIdx.x == 0) {  // one thread per block: double precision is slow on most GPUs
    const double samples = 3.0 * totals[2], lambda = static_cast<double>(lambda_dssim);
    weights.set(0, static_cast<float>((1.0 - lambda) / samples));
    weights.set(1, static_cast<float>(-lambda / samples));
  }
  __syncthreads();
  if (!size.holds(pixel.x, pixel.y)) return;
  const std::size_t p = size.at(pixel.x, pixel.y), at = channel * pixels + p;
  const bool counts = valid.empty() || valid[p] != 0;
  float result = 0;
  if (counts) {  // so the number of samples is not 0
    const float l1_weight = weights.get(0);
    const float a = render[at], b = static_cast<float>(truth[at]) * (1.0f / 255.0f);
    const float sign = a > b ? l1_weight : a < b ? -l1_weight : 0.0f;
    result = sign + weights.get(1) * (sums[0] + 2.0f * a * sums[1] + b * sums[2]);
  }
  gradient[at] = result;
}

}  // namespace

/// A ring of pinned slots.
struct PendingLosses::State {
  explicit State(CudaStream& stream) : totals(stream) {}
  LossTotals with_lambda(const std::array<double, kTotals>& sums) {
    return {sums[0], sums[1], sums[2], lambdas[taken++ % kCapacity]};
  }

  Readbacks<std::array<double, kTotals>, kCapacity> totals;
  std::array<double, kCapacity> lambdas{};  ///< as passed to the calls
  std::size_t sent = 0, taken = 0;
};

PendingLosses::PendingLosses(CudaStream& stream) : state_(std::make_unique<State>(stream)) {}
PendingLosses::~PendingLosses() = default;

bool PendingLosses::is_full() const { return state_->totals.is_full(); }

void PendingLosses::send(const DeviceArray<double>& totals, float lambda_dssim) {
  state_->totals.send(totals.data());
  state_->lambdas[state_->sent++ % kCapacity] = static_cast<double>(lambda_dssim);
}

std::optional<LossTotals> PendingLosses::take() {
  const std::optional<std::array<double, kTotals>> sums = state_->totals.take();
  if (!sums) return std::nullopt;
  return state_->with_lambda(*sums);
}

LossTotals PendingLosses::wait() { return state_->with_lambda(state_->totals.wait()); }

void photometric(std::span<const float> render, const TruthImage& truth, float lambda_dssim, std::span<float> gradient,
                 PhotometricWorkspace& workspace, CudaStream& stream) {
  const ImageSize size{truth.width, truth.height};
  const dim3 blocks = ssim_blocks(truth.width, truth.height, 3);
  workspace.derivatives.ensure(gradient.empty() ? 0 : 3 * render.size());
  workspace.sums.ensure(static_cast<std::size_t>(kTotals) * blocks.x * blocks.y * blocks.z);
  workspace.totals.ensure(kTotals);
  launch(stream, "similarity", similarity_kernel, blocks, dim3(kSsimThreads), size, render, truth.color, truth.valid,
         workspace.derivatives.span(), workspace.sums.span());
  launch(stream, "photometric_totals", sum_blocks_kernel<kTotals>, dim3(1), dim3(kSsimThreads),
         std::span<const double>(workspace.sums.span()), 1.0, workspace.totals.span());
  workspace.losses.send(workspace.totals, lambda_dssim);
  if (gradient.empty()) return;
  launch(stream, "photometric_gradient", gradient_kernel, blocks, dim3(kSsimThreads), size, render, truth.color,
         truth.valid, std::span<const float>(workspace.derivatives.span()),
         std::span<const double>(workspace.totals.span()), lambda_dssim, gradient);
}

}  // namespace splatboost::cuda
