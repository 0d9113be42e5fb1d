// SPDX-License-Identifier: Apache-2.0
// The loss in three kernels: SSIM's values and derivatives of each tile of pixels; the sums of the tiles; the gradient,
// which blurs the derivatives once more, the window being its own adjoint.
#include <array>

#include "cuda_event.h"
#include "cuda_operations.h"
#include "device_view.h"
#include "host_device.h"
#include "launch.h"
#include "photometric_math.h"

namespace splatboost::cuda {
namespace {

constexpr int kTile = 16;  // px; a thread a pixel
constexpr int kThreads = kTile * kTile;
constexpr int kSide = kTile + 2 * kSsimRadius;  // with the halo
constexpr int kWarps = kThreads / 32;
constexpr int kTotals = 3;  // Σ |difference|, Σ SSIM, counted pixels

struct ImageSize {
  int width, height;
  __device__ bool holds(int x, int y) const { return x >= 0 && y >= 0 && x < width && y < height; }
  __device__ std::size_t pixels() const { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
  __device__ std::size_t at(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
  }
};

using Pixels = SharedArray<float, kSide * kSide>;
using Rows = SharedArray<float, kSide * kTile>;

/// Of a row or column of the window, 0 .. 10. In unrolled loops it is a constant.
__device__ float window_weight(int k) {
  constexpr float kWeights[] = {kSsimWindow[0], kSsimWindow[1], kSsimWindow[2],
                                kSsimWindow[3], kSsimWindow[4], kSsimWindow[5]};
  return kWeights[k <= kSsimRadius ? k : 2 * kSsimRadius - k];
}

/// Σ along y of rows that were blurred along x.
__device__ float blur_down(const Rows& rows, int x, int y) {
  float sum = 0;
#pragma unroll
  for (int k = 0; k <= 2 * kSsimRadius; ++k) sum += window_weight(k) * rows.get((y + k) * kTile + x);
  return sum;
}

/// Sum over the block in a fixed order, known to the first thread.
__device__ double block_sum(float value, SharedArray<float, kWarps>& warps) {
  const float sum = warp_sum(value);
  const int thread = static_cast<int>(threadIdx.x);
  if (thread % 32 == 0) warps.set(thread / 32, sum);
  __syncthreads();
  double total = 0;
  if (thread == 0) {
    for (int w = 0; w < kWarps; ++w) total += static_cast<double>(warps.get(w));
  }
  __syncthreads();
  return total;
}

__global__ void __launch_bounds__(kThreads)
    similarity_kernel(ImageSize size, DeviceView<const float> render, DeviceView<const std::uint8_t> truth,
                      DeviceView<const std::uint8_t> valid, DeviceView<float> derivatives, DeviceView<double> sums) {
  __shared__ Pixels renders, truths;
  __shared__ Rows mean_render, mean_truth, mean_squares, mean_product;
  __shared__ SharedArray<float, kWarps> warps;
  const int thread = static_cast<int>(threadIdx.x);
  const int x0 = static_cast<int>(blockIdx.x) * kTile, y0 = static_cast<int>(blockIdx.y) * kTile;
  const std::size_t pixels = size.pixels(), channel = blockIdx.z;

  // Zero outside the image; where a pixel is not valid the render reads as truth.
  for (int k = thread; k < kSide * kSide; k += kThreads) {
    const int x = x0 + k % kSide - kSsimRadius, y = y0 + k / kSide - kSsimRadius;
    float a = 0, b = 0;
    if (size.holds(x, y)) {
      const std::size_t p = size.at(x, y);
      b = static_cast<float>(truth[channel * pixels + p]) * (1.0f / 255.0f);
      a = valid.empty() || valid[p] != 0 ? render[channel * pixels + p] : b;
    }
    renders.set(k, a);
    truths.set(k, b);
  }
  __syncthreads();
  for (int k = thread; k < kSide * kTile; k += kThreads) {
    const int from = k / kTile * kSide + k % kTile;
    float ra = 0, rb = 0, squares = 0, product = 0;
#pragma unroll
    for (int j = 0; j <= 2 * kSsimRadius; ++j) {
      const float weight = window_weight(j), a = renders.get(from + j), b = truths.get(from + j);
      ra += weight * a;
      rb += weight * b;
      squares += weight * (a * a + b * b);
      product += weight * (a * b);
    }
    mean_render.set(k, ra);
    mean_truth.set(k, rb);
    mean_squares.set(k, squares);
    mean_product.set(k, product);
  }
  __syncthreads();

  const int column = thread % kTile, row = thread / kTile, x = x0 + column, y = y0 + row;
  const SsimPixel<float> s = ssim_pixel(blur_down(mean_render, column, row), blur_down(mean_truth, column, row),
                                        blur_down(mean_squares, column, row), blur_down(mean_product, column, row));
  const bool inside = size.holds(x, y);
  const std::size_t p = inside ? size.at(x, y) : 0;
  const bool counts = inside && (valid.empty() || valid[p] != 0);
  if (inside && !derivatives.empty()) {
    const std::size_t at = channel * pixels + p;
    derivatives[at] = counts ? s.d_mean : 0.0f;
    derivatives[3 * pixels + at] = counts ? s.d_square : 0.0f;
    derivatives[6 * pixels + at] = counts ? s.d_product : 0.0f;
  }
  const int middle = (row + kSsimRadius) * kSide + column + kSsimRadius;
  const double l1 = block_sum(counts ? fabsf(renders.get(middle) - truths.get(middle)) : 0.0f, warps);
  const double ssim = block_sum(counts ? s.value : 0.0f, warps);
  const double counted = block_sum(counts && channel == 0 ? 1.0f : 0.0f, warps);
  if (thread == 0) {
    const std::size_t block = (channel * gridDim.y + blockIdx.y) * gridDim.x + blockIdx.x;
    sums[kTotals * block] = l1;
    sums[kTotals * block + 1] = ssim;
    sums[kTotals * block + 2] = counted;
  }
}

/// One block adds up the tiles, in a fixed order.
__global__ void __launch_bounds__(kThreads) totals_kernel(DeviceView<const double> sums, DeviceView<double> totals) {
  __shared__ SharedArray<double, kThreads> parts;
  const int thread = static_cast<int>(threadIdx.x);
  for (std::size_t q = 0; q < kTotals; ++q) {
    double sum = 0;
    for (std::size_t i = threadIdx.x; kTotals * i < sums.size(); i += kThreads) sum += sums[kTotals * i + q];
    parts.set(thread, sum);
    __syncthreads();
    for (int step = kThreads / 2; step > 0; step /= 2) {
      const double pair = thread < step ? parts.get(thread) + parts.get(thread + step) : 0.0;
      __syncthreads();
      if (thread < step) parts.set(thread, pair);
      __syncthreads();
    }
    if (thread == 0) totals[q] = parts.get(0);
    __syncthreads();
  }
}

__global__ void __launch_bounds__(kThreads)
    gradient_kernel(ImageSize size, DeviceView<const float> render, DeviceView<const std::uint8_t> truth,
                    DeviceView<const std::uint8_t> valid, DeviceView<const float> derivatives,
                    DeviceView<const double> totals, float lambda_dssim, DeviceView<float> gradient) {
  __shared__ Pixels map;
  __shared__ Rows rows;
  const int thread = static_cast<int>(threadIdx.x);
  const int x0 = static_cast<int>(blockIdx.x) * kTile, y0 = static_cast<int>(blockIdx.y) * kTile;
  const std::size_t pixels = size.pixels(), channel = blockIdx.z;
  const int column = thread % kTile, row = thread / kTile;
  float blurred[3];
  for (std::size_t q = 0; q < 3; ++q) {
    for (int k = thread; k < kSide * kSide; k += kThreads) {
      const int x = x0 + k % kSide - kSsimRadius, y = y0 + k / kSide - kSsimRadius;
      map.set(k, size.holds(x, y) ? derivatives[(3 * q + channel) * pixels + size.at(x, y)] : 0.0f);
    }
    __syncthreads();
    for (int k = thread; k < kSide * kTile; k += kThreads) {
      const int from = k / kTile * kSide + k % kTile;
      float sum = 0;
#pragma unroll
      for (int j = 0; j <= 2 * kSsimRadius; ++j) sum += window_weight(j) * map.get(from + j);
      rows.set(k, sum);
    }
    __syncthreads();
    blurred[q] = blur_down(rows, column, row);
    __syncthreads();
  }
  const int x = x0 + column, y = y0 + row;
  if (!size.holds(x, y)) return;
  const std::size_t p = size.at(x, y), at = channel * pixels + p;
  const bool counts = valid.empty() || valid[p] != 0;
  const double samples = 3.0 * totals[2], lambda = static_cast<double>(lambda_dssim);
  float result = 0;
  if (counts) {  // so there are samples
    const auto l1_weight = static_cast<float>((1.0 - lambda) / samples);
    const auto ssim_weight = static_cast<float>(-lambda / samples);
    const float a = render[at], b = static_cast<float>(truth[at]) * (1.0f / 255.0f);
    const float sign = a > b ? l1_weight : a < b ? -l1_weight : 0.0f;
    result = sign + ssim_weight * (blurred[0] + 2.0f * a * blurred[1] + b * blurred[2]);
  }
  gradient[at] = result;
}

}  // namespace

/// A ring of pinned slots.
struct LossesOnTheWay::State {
  struct Slot {
    explicit Slot(CudaStream& stream) : arrived(stream, cudaEventDisableTiming) {}
    Event arrived;
    double lambda_dssim = 0;
  };
  explicit State(CudaStream& on)
      : stream(on), totals(static_cast<double*>(on.allocate_pinned(kMost * kTotals * sizeof(double)))) {
    for (std::unique_ptr<Slot>& slot : slots) slot = std::make_unique<Slot>(on);
  }
  ~State() { stream.release_pinned(totals); }
  Slot& slot(std::size_t number) { return *slots[number % kMost]; }
  LossTotals take_oldest() {
    const double* const at = totals + kTotals * (taken % kMost);
    return {at[0], at[1], at[2], slot(taken++).lambda_dssim};
  }

  CudaStream& stream;
  double* totals;  ///< pinned, [kMost,3]
  std::array<std::unique_ptr<Slot>, kMost> slots;
  std::size_t sent = 0, taken = 0;
};

LossesOnTheWay::LossesOnTheWay(CudaStream& stream) : state_(std::make_unique<State>(stream)) {}
LossesOnTheWay::~LossesOnTheWay() = default;

bool LossesOnTheWay::is_full() const { return state_->sent - state_->taken == kMost; }

void LossesOnTheWay::send(const DeviceArray<double>& totals, float lambda_dssim) {
  State& s = *state_;
  s.stream.copy_to_pinned(s.totals + kTotals * (s.sent % kMost), totals.data(), kTotals * sizeof(double));
  s.slot(s.sent).lambda_dssim = static_cast<double>(lambda_dssim);
  s.slot(s.sent++).arrived.record();
}

std::optional<LossTotals> LossesOnTheWay::take() {
  State& s = *state_;
  if (s.taken == s.sent || !s.slot(s.taken).arrived.is_done()) return std::nullopt;
  return s.take_oldest();
}

LossTotals LossesOnTheWay::wait() {
  State& s = *state_;
  s.slot(s.taken).arrived.wait();
  return s.take_oldest();
}

void photometric(std::span<const float> render, const TruthImage& truth, float lambda_dssim, std::span<float> gradient,
                 PhotometricWorkspace& workspace, CudaStream& stream) {
  const ImageSize size{truth.width, truth.height};
  const auto tiles = [](int length) { return static_cast<unsigned>((length + kTile - 1) / kTile); };
  const dim3 blocks(tiles(truth.width), tiles(truth.height), 3);
  workspace.derivatives.ensure(gradient.empty() ? 0 : 3 * render.size());
  workspace.sums.ensure(static_cast<std::size_t>(kTotals) * blocks.x * blocks.y * blocks.z);
  workspace.totals.ensure(kTotals);
  launch(stream, "similarity", similarity_kernel, blocks, dim3(kThreads), size, render, truth.color, truth.valid,
         workspace.derivatives.span(), workspace.sums.span());
  launch(stream, "photometric_totals", totals_kernel, dim3(1), dim3(kThreads),
         std::span<const double>(workspace.sums.span()), workspace.totals.span());
  workspace.losses.send(workspace.totals, lambda_dssim);
  if (gradient.empty()) return;
  launch(stream, "photometric_gradient", gradient_kernel, blocks, dim3(kThreads), size, render, truth.color,
         truth.valid, std::span<const float>(workspace.derivatives.span()),
         std::span<const double>(workspace.totals.span()), lambda_dssim, gradient);
}

}  // namespace splatboost::cuda
