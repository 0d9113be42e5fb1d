// SPDX-License-Identifier: Apache-2.0
// One block per tile, one warp per 8 × 4 pixels, one thread per pixel. Convexes are loaded into shared memory in
// batches of one per lane; each lane tests for one of them whether it can reach the warp's pixels at all.
#include "convexes/cuda_convex_frame.h"
#include "device/device_view.h"
#include "device/launch.h"
#include "rasterizer/weight_sums.h"
#include "splatboost/constants.h"

namespace splatboost::cuda {
namespace {

constexpr std::uint32_t kTileThreads = kTileSize * kTileSize;
constexpr std::uint32_t kBatch = 32;
/// Pixels of a warp.
constexpr std::uint32_t kWarpWidth = 8, kWarpHeight = 32 / kWarpWidth, kWarpsAcross = kTileSize / kWarpWidth;

struct ConvexLists {
  DeviceView<const ConvexTileEntries> tiles;
  DeviceView<const std::uint32_t> entries;
  DeviceView<const ConvexRecord> records;
  std::uint32_t tiles_x, width, height;

  explicit ConvexLists(const CudaConvexFrame& frame)
      : tiles(frame.tile_entries.span()),
        entries(frame.entries.span()),
        records(frame.records.span()),
        tiles_x(static_cast<std::uint32_t>(frame.view.tiles_x)),
        width(static_cast<std::uint32_t>(frame.camera.width)),
        height(static_cast<std::uint32_t>(frame.camera.height)) {}
};

/// A thread's pixel.
struct Pixel {
  bool inside;
  float centre_x, centre_y;
  float middle_x, middle_y;  ///< of the warp's pixels
  std::size_t index, plane;  ///< of the pixel in a plane of the image; size of a plane

  __device__ explicit Pixel(const ConvexLists& lists) {
    const std::uint32_t warp = threadIdx.x / 32, lane = threadIdx.x % 32;
    const std::uint32_t left = blockIdx.x % lists.tiles_x * kTileSize + warp % kWarpsAcross * kWarpWidth;
    const std::uint32_t top = blockIdx.x / lists.tiles_x * kTileSize + warp / kWarpsAcross * kWarpHeight;
    const std::uint32_t x = left + lane % kWarpWidth, y = top + lane / kWarpWidth;
    middle_x = static_cast<float>(left + kWarpWidth / 2);
    middle_y = static_cast<float>(top + kWarpHeight / 2);
    inside = x < lists.width && y < lists.height;
    centre_x = static_cast<float>(x) + 0.5f;
    centre_y = static_cast<float>(y) + 0.5f;
    index = static_cast<std::size_t>(y) * lists.width + x;
    plane = static_cast<std::size_t>(lists.width) * lists.height;
  }
};

/// Effect of one convex on one pixel: the arithmetic that blending, its gradient and the count replay share.
struct ConvexPixelStep {
  float dx, dy;
  float terms[kMaxConvexPoints];  ///< t_k
  float phi, inside, alpha, after;
  bool blended;
};

/// Applies a convex to a pixel; the caller updates the transmittance. A pixel that the convex would saturate is closed
/// without blending it.
__device__ inline ConvexPixelStep step_pixel(const ConvexRecord& convex, const Pixel& pixel, float transmittance,
                                             bool& open) {
  ConvexPixelStep step;
  step.blended = false;
  step.dx = pixel.centre_x - convex.centre_x;
  step.dy = pixel.centre_y - convex.centre_y;
  float greatest = -1e30f;
#pragma unroll
  for (int k = 0; k < kMaxConvexPoints; ++k) {
    // Explicit, so that the compiler does not contract operations differently in different kernels.
    step.terms[k] = fmaf(step.dy, convex.edge_y[k], fmaf(step.dx, convex.edge_x[k], convex.edge_offset[k]));
    greatest = fmaxf(greatest, step.terms[k]);
  }
  if (!open || greatest > convex.farthest) return step;
  float sum = 0.0f;
#pragma unroll
  for (int k = 0; k < kMaxConvexPoints; ++k) sum += exp2f(fmaxf(step.terms[k] - greatest, -126.0f));
  step.phi = greatest + log2f(sum);
  const float exponent = fminf(fmaxf(__fmul_rn(step.phi, convex.steepness), -126.0f), 100.0f);
  step.inside = 1.0f / (1.0f + exp2f(exponent));
  step.alpha = fminf(__fmul_rn(convex.opacity, step.inside), kMaxAlpha);
  step.after = fmaf(-transmittance, step.alpha, transmittance);
  step.blended = step.alpha >= kMinAlpha;
  if (step.blended && step.after < kMinTransmittance) open = step.blended = false;
  return step;
}

/// Whether a convex may have max_k t_k <= farthest at a pixel of the warp. Where this is false, step_pixel() blends it
/// nowhere: the slack exceeds the rounding errors of both.
__device__ inline bool may_reach(const ConvexRecord& convex, const Pixel& pixel) {
  constexpr float kHalfWidth = 0.5f * (kWarpWidth - 1), kHalfHeight = 0.5f * (kWarpHeight - 1), kSlack = 1e-5f;
  const float dx = pixel.middle_x - convex.centre_x, dy = pixel.middle_y - convex.centre_y;
  bool reaches = true;
#pragma unroll
  for (int k = 0; k < kMaxConvexPoints; ++k) {
    const float x = convex.edge_x[k] * dx, y = convex.edge_y[k] * dy, offset = convex.edge_offset[k];
    const float reach = fabsf(convex.edge_x[k]) * kHalfWidth + fabsf(convex.edge_y[k]) * kHalfHeight;
    const float slack = kSlack * (fabsf(x) + fabsf(y) + fabsf(offset) + reach);
    reaches = reaches && !(x + y + offset - reach - slack > convex.farthest);
  }
  return reaches;
}

/// Visits the convexes that may reach a warp's pixels, near to far, until all of these are closed. All threads of the
/// block must call it.
/// @param visit (index of the convex, record): called by whole warps; may close pixels
template <class Visit>
__device__ void visit_convexes(const ConvexLists& lists, const Pixel& pixel, const bool& open, Visit&& visit) {
  static_assert(kBatch == 32, "one convex per lane");
  __shared__ SharedArray<ConvexRecord, static_cast<int>(kBatch)> batch;
  __shared__ SharedArray<std::uint32_t, static_cast<int>(kBatch)> owners;
  const int lane = static_cast<int>(threadIdx.x % 32);
  const ConvexTileEntries range = lists.tiles[blockIdx.x];
  for (std::uint32_t base = range.begin; base < range.end; base += kBatch) {
    if (!__syncthreads_or(open)) break;  // also a barrier: the previous batch is no longer read
    if (threadIdx.x < kBatch && base + threadIdx.x < range.end) {
      const std::uint32_t convex = lists.entries[base + threadIdx.x];
      owners.set(static_cast<int>(threadIdx.x), convex);
      batch.set(static_cast<int>(threadIdx.x), lists.records[convex]);
    }
    __syncthreads();
    const int count = static_cast<int>(min(kBatch, range.end - base));
    const bool reaches = lane < count && may_reach(batch.get(min(lane, count - 1)), pixel);
    for (unsigned next = __ballot_sync(kWholeWarp, reaches); next != 0; next &= next - 1) {
      if (!__any_sync(kWholeWarp, open)) break;
      const int k = __ffs(static_cast<int>(next)) - 1;
      visit(owners.get(k), batch.get(k));
    }
  }
}

struct ConvexImages {
  DeviceView<float> pixels, color, alpha;
  float background[3];
};

__global__ void __launch_bounds__(kTileThreads) blend_convexes_kernel(ConvexLists lists, ConvexImages images) {
  const Pixel pixel(lists);
  bool open = pixel.inside;
  float transmittance = 1.0f, color[3] = {};
  visit_convexes(lists, pixel, open, [&](std::uint32_t, const ConvexRecord& convex) {
    const ConvexPixelStep step = step_pixel(convex, pixel, transmittance, open);
    if (!step.blended) return;
    const float weight = transmittance * step.alpha;
    transmittance = step.after;
    color[0] = fmaf(weight, convex.red, color[0]);
    color[1] = fmaf(weight, convex.green, color[1]);
    color[2] = fmaf(weight, convex.blue, color[2]);
  });
  if (!pixel.inside) return;
  for (int c = 0; c < 3; ++c) {
    const float value = fmaf(transmittance, images.background[c], color[c]);
    images.color[c * pixel.plane + pixel.index] = value;
    images.pixels[c * pixel.plane + pixel.index] = value;
  }
  images.pixels[3 * pixel.plane + pixel.index] = 1.0f - transmittance;
  if (!images.alpha.empty()) images.alpha[pixel.index] = 1.0f - transmittance;
}

__global__ void __launch_bounds__(kTileThreads)
    blend_convexes_backward_kernel(ConvexLists lists, DeviceView<const float> pixels, DeviceView<const float> color,
                                   DeviceView<const float> alpha, DeviceView<float> moments) {
  const Pixel pixel(lists);
  // Gradients of uncovered pixels are not read: they may be NaN.
  const bool covered = pixel.inside && pixels[3 * pixel.plane + pixel.index] > 0.0f;
  bool open = covered;
  float transmittance = 1.0f, g[4] = {}, rest = 0.0f;
  for (int c = 0; c < 4; ++c) {
    const DeviceView<const float>& image = c < 3 ? color : alpha;
    if (!covered || image.empty()) continue;
    g[c] = image[(c < 3 ? c : 0) * pixel.plane + pixel.index];
    rest = fmaf(g[c], pixels[c * pixel.plane + pixel.index], rest);
  }
  visit_convexes(lists, pixel, open, [&](std::uint32_t owner, const ConvexRecord& convex) {
    const ConvexPixelStep step = step_pixel(convex, pixel, transmittance, open);
    if (!__any_sync(kWholeWarp, step.blended)) return;
    const float weight = step.blended ? transmittance * step.alpha : 0.0f;
    const float along = fmaf(g[0], convex.red, fmaf(g[1], convex.green, fmaf(g[2], convex.blue, g[3])));
    const float gain = weight * along;
    rest -= gain;
    // s = α·dL/dα = weight·along − rest·α/(1 − α), and α/(1 − α) = weight/after.
    const bool moves = step.blended && step.alpha < kMaxAlpha;
    const float s = moves ? gain - rest * (weight / step.after) : 0.0f;
    if (step.blended) transmittance = step.after;
    const float u = moves ? s * step.inside - s : 0.0f;
    const float by_phi = moves ? u * step.phi : 0.0f;
    float parts[kConvexMomentColumns] = {weight * g[0], weight * g[1], weight * g[2], s, by_phi, fabsf(by_phi)};
#pragma unroll
    for (int k = 0; k < kMaxConvexPoints; ++k) {
      if (k >= static_cast<int>(convex.edges)) continue;  // the same for the whole warp
      const float part = moves ? u * exp2f(fmaxf(step.terms[k] - step.phi, -126.0f)) : 0.0f;
      parts[8 + 3 * k] = part;
      parts[9 + 3 * k] = part * step.dx;
      parts[10 + 3 * k] = part * step.dy;
    }
    static_assert(kConvexMomentColumns == 32, "one sum per lane");
    const float sum = warp_sums(parts);
    const std::size_t row = static_cast<std::size_t>(owner) * kConvexMomentColumns;
    if (sum != 0.0f) atomicAdd(&moments[row + threadIdx.x % 32], sum);
  });
}

__global__ void __launch_bounds__(kTileThreads)
    count_convexes_kernel(ConvexLists lists, DeviceView<const std::uint8_t> flagged, DeviceView<std::int32_t> counts) {
  const Pixel pixel(lists);
  bool open = pixel.inside && flagged[pixel.index] != 0;  // pixels without a flag need no replay
  float transmittance = 1.0f;
  if (!__syncthreads_or(open)) return;  // the whole block returns: nothing to count
  visit_convexes(lists, pixel, open, [&](std::uint32_t owner, const ConvexRecord& convex) {
    const ConvexPixelStep step = step_pixel(convex, pixel, transmittance, open);
    if (step.blended) transmittance = step.after;
    const int counted = __popc(__ballot_sync(kWholeWarp, step.blended));
    if (counted != 0 && threadIdx.x % 32 == 0) atomicAdd(&counts[owner], counted);
  });
}

__global__ void __launch_bounds__(kTileThreads)
    weigh_convexes_kernel(ConvexLists lists, DeviceView<std::int32_t> weights) {
  const Pixel pixel(lists);
  bool open = pixel.inside;
  float transmittance = 1.0f;
  visit_convexes(lists, pixel, open, [&](std::uint32_t owner, const ConvexRecord& convex) {
    const ConvexPixelStep step = step_pixel(convex, pixel, transmittance, open);
    int weight = 0;
    if (step.blended) {
      weight = static_cast<int>(rintf(transmittance * step.alpha * (1 / kWeightUnit)));
      transmittance = step.after;
    }
#pragma unroll
    for (int distance = 16; distance > 0; distance /= 2) weight += __shfl_xor_sync(kWholeWarp, weight, distance);
    if (weight != 0 && threadIdx.x % 32 == 0) add_weight(weights[owner], weight);
  });
}

dim3 blocks_of(const CudaConvexFrame& frame) { return dim3(static_cast<std::uint32_t>(frame.tiles())); }

}  // namespace

void blend_convexes(CudaConvexFrame& frame, std::span<float> color, std::span<float> alpha, CudaStream& stream) {
  frame.pixels.ensure(4 * frame.image_pixels());
  const glm::vec3 background = frame.options.background;
  const ConvexImages images{frame.pixels.span(), color, alpha, {background.x, background.y, background.z}};
  launch(stream, "blend_convexes", blend_convexes_kernel, blocks_of(frame), dim3(kTileThreads), ConvexLists(frame),
         images);
}

void blend_convexes_backward(CudaConvexFrame& frame, std::span<const float> color, std::span<const float> alpha,
                             CudaStream& stream) {
  frame.moments.ensure(frame.convexes * kConvexMomentColumns);
  frame.moments.fill_zero();
  launch(stream, "blend_convexes_backward", blend_convexes_backward_kernel, blocks_of(frame), dim3(kTileThreads),
         ConvexLists(frame), std::as_const(frame.pixels).span(), color, alpha, frame.moments.span());
}

void count_flagged_convexes(const CudaConvexFrame& frame, std::span<const std::uint8_t> flagged,
                            std::span<std::int32_t> counts, CudaStream& stream) {
  launch(stream, "count_convexes", count_convexes_kernel, blocks_of(frame), dim3(kTileThreads), ConvexLists(frame),
         flagged, counts);
}

void add_convex_weights(const CudaConvexFrame& frame, std::span<std::int32_t> weights, CudaStream& stream) {
  launch(stream, "weigh_convexes", weigh_convexes_kernel, blocks_of(frame), dim3(kTileThreads), ConvexLists(frame),
         weights);
}

}  // namespace splatboost::cuda
