// SPDX-License-Identifier: Apache-2.0
#include "splatboost/photometric.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "loss/cuda_ops.h"
#include "splatboost/errors.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "loss/photometric_cpu.cpp"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "device/lanes-inl.h"
#include "loss/photometric_math.h"

#ifndef SPLATBOOST_PHOTOMETRIC_JOB_
#define SPLATBOOST_PHOTOMETRIC_JOB_
namespace splatboost {

/// One channel of the images, and its outputs; all [H,W].
struct PhotometricJob {
  std::size_t width, height;
  const float* render;
  const std::uint8_t* truth;
  const std::uint8_t* valid;  ///< null: all are valid
  float* gradient;            ///< null: value only
  float l1_weight;            ///< d total / d |render − truth| of one pixel
  float ssim_weight;          ///< d total / d SSIM of one pixel
};

inline constexpr std::size_t kHalo = kSsimRadius;
inline constexpr std::size_t kWindow = 2 * kHalo + 1;
/// Size of the blocks in which an image is processed, from the pixels to the gradient: narrow enough that the window's
/// eleven rows of all blurred quantities stay in the L1 cache, high enough that the halo above and below is cheap.
inline constexpr std::size_t kBlockColumns = 96;
inline constexpr std::size_t kBlockRows = 256;
/// Number of rows by which memory is requested in advance: a block's rows are too short for the processor to do so.
inline constexpr std::size_t kRowsAhead = 4;
inline constexpr std::size_t kCacheLine = 64;  ///< bytes
/// Columns where SSIM's derivatives are needed: the block's and its halo, in whole vectors.
inline constexpr std::size_t kMapColumns = kBlockColumns + 16;
/// Columns of pixels that these need.
inline constexpr std::size_t kPixelColumns = kMapColumns + 16;
static_assert(kPixelColumns >= kBlockColumns + 2 * 16, "blur_row() reads a vector beyond the last that it writes");

struct BlockRange {
  std::size_t x0, columns, y0, rows;
};

struct PhotometricSums {
  double l1 = 0;
  double ssim = 0;
};

}  // namespace splatboost
#endif  // SPLATBOOST_PHOTOMETRIC_JOB_

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

/// Rows blurred along x, of which the last eleven are kept.
template <std::size_t kQuantities, std::size_t kColumns>
struct BlurredRows {
  alignas(64) float rows[kQuantities][kWindow][kColumns];

  float* slot(std::size_t quantity, std::size_t row) { return rows[quantity][row % kWindow]; }

  /// The rows of a window, oldest first, of the first quantity.
  struct Window {
    const float* row[kWindow];
  };
  Window window(std::size_t newest) const {
    Window window;
    for (std::size_t k = 0; k < kWindow; ++k) window.row[k] = rows[0][(newest + 1 + k) % kWindow];
    return window;
  }

  /// A window's sum along y, at column x.
  static HWY_INLINE Float blur(const Window& window, std::size_t quantity, std::size_t x) {
    const std::size_t at = quantity * kWindow * kColumns + x;
    Float sum = Float(kSsimWindow[kHalo]) * load(window.row[kHalo] + at);
    for (std::size_t k = 0; k < kHalo; ++k) {
      sum += Float(kSsimWindow[k]) * (load(window.row[k] + at) + load(window.row[kWindow - 1 - k] + at));
    }
    return sum;
  }
};

/// window[k]·(row[k] + row[10 − k]) at each lane; the vectors are row[0…] and those that follow.
template <int k>
HWY_INLINE Float blurred_pair(const float* HWY_RESTRICT row, Float first, Float second) {
  constexpr int kLast = 2 * kHalo;
  return Float(kSsimWindow[k]) * (load_after<k>(row, first, second) + load_after<kLast - k>(row, first, second));
}

/// to[x] = Σ_k window[k]·padded[x + k]; reads whole vectors, and one more than the last that it writes.
HWY_INLINE void blur_row(const float* HWY_RESTRICT padded, std::size_t columns, float* HWY_RESTRICT to) {
  static_assert(kHalo == 5);
  Float first = load(padded);
  for (std::size_t x = 0; x < columns; x += lanes()) {
    const float* const row = padded + x;
    const Float second = load(row + lanes());
    // In this order compilers fuse products and sums as in the loop that this was, with the same bytes.
    Float sum = blurred_pair<0>(row, first, second);
    sum += Float(kSsimWindow[kHalo]) * load_after<kHalo>(row, first, second);
    sum += blurred_pair<1>(row, first, second);
    sum += blurred_pair<2>(row, first, second);
    sum += blurred_pair<3>(row, first, second);
    sum += blurred_pair<4>(row, first, second);
    store(sum, to + x);
    first = second;
  }
}

/// A stretch of a row that begins `before` columns before the block. Only its columns within the image are copied.
struct Stretch {
  std::size_t first, count, offset;  ///< columns [first, first + count) of the image go to `offset`
  Stretch(const BlockRange& block, std::size_t width, std::size_t before, std::size_t columns)
      : first(block.x0 < before ? 0 : block.x0 - before), offset(before + first - block.x0) {
    count = std::min(width - first, columns - offset);
  }
};

/// to[x] = of(from + x) for x < count, in whole vectors, the last of which overlaps the one before.
template <class From, class Of>
HWY_INLINE void map_row(const From* HWY_RESTRICT from, std::size_t count, float* HWY_RESTRICT to, Of of) {
  if (count < lanes()) {
    alignas(64) From padded[kTileSize] = {};
    alignas(64) float values[kTileSize];
    std::copy_n(from, count, padded);
    store(of(padded), values);
    std::copy_n(values, count, to);
    return;
  }
  for (std::size_t x = 0; x + lanes() < count; x += lanes()) store(of(from + x), to + x);
  store(of(from + count - lanes()), to + count - lanes());
}

HWY_INLINE void copy_row(const float* HWY_RESTRICT from, std::size_t count, float* HWY_RESTRICT to) {
  map_row(from, count, to, [](const float* at) HWY_ATTR { return load(at); });
}

/// Loads truth and render of the columns of one row that lie within the image; where a pixel is not valid, render =
/// truth.
HWY_INLINE void load_pixels(const PhotometricJob& job, std::size_t y, const Stretch& stretch, float* render,
                            float* truth) {
  const std::size_t at = y * job.width + stretch.first;
  render += stretch.offset;
  truth += stretch.offset;
  map_row(job.truth + at, stretch.count, truth,
          [](const std::uint8_t* bytes) HWY_ATTR { return load_bytes(bytes) * Float(1.0f / 255.0f); });
  if (job.valid == nullptr) {
    copy_row(job.render + at, stretch.count, render);
  } else {
    for (std::size_t x = 0; x < stretch.count; ++x) {
      render[x] = job.valid[at + x] != 0 ? job.render[at + x] : truth[x];
    }
  }
}

/// Requests the cache lines of the pixels that load_pixels() reads.
HWY_INLINE void prefetch_pixels(const PhotometricJob& job, std::size_t y, const Stretch& stretch) {
  const std::size_t at = y * job.width + stretch.first;
  for (std::size_t x = 0; x < stretch.count; x += kCacheLine / sizeof(float)) hwy::Prefetch(job.render + at + x);
  for (std::size_t x = 0; x < stretch.count; x += kCacheLine) hwy::Prefetch(job.truth + at + x);
}

/// Requests the cache lines of a row of the gradient.
HWY_INLINE void prefetch_gradient(const PhotometricJob& job, std::size_t y, const BlockRange& block) {
  const float* const row = job.gradient + y * job.width + block.x0;
  for (std::size_t x = 0; x < block.columns; x += kCacheLine / sizeof(float)) hwy::Prefetch(row + x);
}

/// Sets counts to 1 where a pixel of a row is valid, 0 where it is not or lies outside the image.
template <std::size_t kColumns>
void load_counts(const PhotometricJob& job, std::size_t y, const Stretch& stretch, float (&counts)[kColumns]) {
  std::fill_n(counts, kColumns, 0.0f);
  const std::size_t at = y * job.width + stretch.first;
  for (std::size_t x = 0; x < stretch.count; ++x) {
    counts[stretch.offset + x] = job.valid == nullptr || job.valid[at + x] != 0 ? 1.0f : 0.0f;
  }
}

HWY_INLINE double sum_of(Float a) {
  alignas(64) float values[kTileSize];
  store(a, values);
  double sum = 0;
  for (std::size_t i = 0; i < lanes(); ++i) sum += static_cast<double>(values[i]);
  return sum;
}

/// A sum of many numbers: the lanes accumulate a few rows, and are then added to a double.
struct LaneSum {
  static constexpr int kRows = 16;
  Float lanes_sum;
  int rows;
  double total;

  HWY_INLINE LaneSum() : lanes_sum(0.0f), rows(0), total(0) {}

  HWY_INLINE void add(Float a) { lanes_sum += a; }
  void end_row() {
    if (++rows == kRows) flush();
  }
  void flush() {
    total += sum_of(lanes_sum);
    lanes_sum = Float(0.0f);
    rows = 0;
  }
};

/// Value and gradient of one block of one channel, in one sweep down the rows: pixels are blurred along x; five rows
/// later, along y, which gives SSIM and its derivatives; these are blurred in turn (the window is its own adjoint),
/// which gives the gradient another five rows later.
void photometric_block(const PhotometricJob& job, const BlockRange& block, PhotometricSums& sums) {
  enum : std::size_t { kRender, kTruth, kSquares, kProduct, kQuantities };
  alignas(64) float pixels[kQuantities][kPixelColumns] = {};         // columns outside the image stay 0
  alignas(64) float derivatives[3][kMapColumns + 16] = {};           // by means, squares, products
  alignas(64) float counts[kMapColumns], own_counts[kBlockColumns];  // 1 where a pixel counts, else 0
  BlurredRows<kQuantities, kMapColumns> blurred;
  BlurredRows<3, kBlockColumns> blurred_derivatives;
  const Stretch pixel_stretch(block, job.width, 2 * kHalo, kPixelColumns);
  const Stretch map_stretch(block, job.width, kHalo, kMapColumns);
  const Stretch block_stretch(block, job.width, 0, kBlockColumns);
  alignas(64) float render_row[kBlockColumns] = {}, truth_row[kBlockColumns] = {}, gradient[kBlockColumns];
  const bool wants_gradient = job.gradient != nullptr;
  // Without a gradient, the rows of derivatives and their halo are not needed.
  const std::size_t above = wants_gradient ? 2 * kHalo : kHalo;
  const std::size_t map_columns = kHalo + block.columns + kHalo;
  const Float zero(0.0f), l1_weight(job.l1_weight), ssim_weight(job.ssim_weight);
  LaneSum l1, ssim;
  sums = {};
  if (job.valid == nullptr) {  // the same for all rows
    load_counts(job, 0, map_stretch, counts);
    load_counts(job, 0, block_stretch, own_counts);
  }

  for (std::size_t r = 0; r < block.rows + 2 * above; ++r) {
    const std::size_t y = block.y0 + r - above;  // unsigned: wraps below zero, and then exceeds the height too
    if (y >= job.height) {
      for (std::size_t q = 0; q < kQuantities; ++q) std::fill_n(blurred.slot(q, r), kMapColumns, 0.0f);
    } else {
      float *const render = pixels[kRender], *const truth = pixels[kTruth];
      load_pixels(job, y, pixel_stretch, render, truth);
      if (y + kRowsAhead < job.height) prefetch_pixels(job, y + kRowsAhead, pixel_stretch);
      for (std::size_t x = 0; x < kPixelColumns; x += lanes()) {
        const Float a = load(render + x), b = load(truth + x);
        store(a * a + b * b, pixels[kSquares] + x);
        store(a * b, pixels[kProduct] + x);
      }
      if (r >= above && r < above + block.rows) {  // pixels that are not valid add 0: render = truth
        std::size_t x = 2 * kHalo;
        const std::size_t last = x + block.columns;
        for (; x + lanes() <= last; x += lanes()) l1.add(abs_of(load(render + x) - load(truth + x)));
        for (; x < last; ++x) sums.l1 += static_cast<double>(std::fabs(render[x] - truth[x]));
        l1.end_row();
      }
      for (std::size_t q = 0; q < kQuantities; ++q) blur_row(pixels[q], map_columns, blurred.slot(q, r));
    }

    if (r < 2 * kHalo) continue;
    const std::size_t map_row = y - kHalo;
    if (map_row >= job.height) {
      if (wants_gradient) {
        for (std::size_t q = 0; q < 3; ++q) std::fill_n(blurred_derivatives.slot(q, r), kBlockColumns, 0.0f);
      }
    } else {
      if (job.valid != nullptr) load_counts(job, map_row, map_stretch, counts);
      const auto window = blurred.window(r);
      const bool own = map_row >= block.y0 && map_row < block.y0 + block.rows;
      alignas(64) float values[kMapColumns];
      for (std::size_t x = 0; x < map_columns; x += lanes()) {
        const SsimPixel<Float> s = ssim_pixel(blurred.blur(window, kRender, x), blurred.blur(window, kTruth, x),
                                              blurred.blur(window, kSquares, x), blurred.blur(window, kProduct, x));
        const Float counted = load(counts + x);
        store(s.value * counted, values + x);
        store(s.d_mean * counted, derivatives[0] + x);
        store(s.d_square * counted, derivatives[1] + x);
        store(s.d_product * counted, derivatives[2] + x);
      }
      if (own) {
        std::size_t x = kHalo;
        const std::size_t last = x + block.columns;
        for (; x + lanes() <= last; x += lanes()) ssim.add(load(values + x));
        for (; x < last; ++x) sums.ssim += static_cast<double>(values[x]);
        ssim.end_row();
      }
      for (std::size_t q = 0; wants_gradient && q < 3; ++q) {
        blur_row(derivatives[q], block.columns, blurred_derivatives.slot(q, r));
      }
    }

    if (!wants_gradient || r < 4 * kHalo) continue;
    const std::size_t row = block.y0 + r - 4 * kHalo;
    if (row + kRowsAhead < block.y0 + block.rows) prefetch_gradient(job, row + kRowsAhead, block);
    load_pixels(job, row, block_stretch, render_row, truth_row);
    if (job.valid != nullptr) load_counts(job, row, block_stretch, own_counts);
    const auto window = blurred_derivatives.window(r);
    for (std::size_t x = 0; x < block.columns; x += lanes()) {
      const Float a = load(render_row + x), b = load(truth_row + x);
      const Float sign = select(a > b, l1_weight, select(a < b, -l1_weight, zero));
      const Float from_ssim = blurred_derivatives.blur(window, 0, x) +
                              Float(2.0f) * a * blurred_derivatives.blur(window, 1, x) +
                              b * blurred_derivatives.blur(window, 2, x);
      store((sign + ssim_weight * from_ssim) * load(own_counts + x), gradient + x);
    }
    copy_row(gradient, block.columns, job.gradient + row * job.width + block.x0);
  }
  l1.flush();
  ssim.flush();
  sums.l1 += l1.total;
  sums.ssim += ssim.total;
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost {
namespace {
HWY_EXPORT(photometric_block);

/// The images' blocks, channel after channel.
struct Blocks {
  std::size_t width, height;
  std::size_t across = (width + kBlockColumns - 1) / kBlockColumns;
  std::size_t down = (height + kBlockRows - 1) / kBlockRows;

  std::size_t count() const { return 3 * across * down; }
  std::size_t channel(std::size_t i) const { return i / (across * down); }
  BlockRange range(std::size_t i) const {
    const std::size_t x0 = i % across * kBlockColumns, y0 = i / across % down * kBlockRows;
    return {x0, std::min(kBlockColumns, width - x0), y0, std::min(kBlockRows, height - y0)};
  }
};

}  // namespace

struct Photometric::State {
  explicit State(Device where) : device(where) {
    if (device.is_cuda()) workspace = std::make_unique<cuda::PhotometricWorkspace>(device.stream());
  }
  Device device;
  std::unique_ptr<cuda::PhotometricWorkspace> workspace;  ///< only on a CUDA device
  std::optional<PhotometricLoss> newest;  ///< newest loss from that device, or the first that was not finite
  std::vector<PhotometricSums> sums;

  void note(const cuda::LossTotals& totals);
};

Photometric::Photometric(Device device) : state_(std::make_unique<State>(device)) {}
Photometric::~Photometric() = default;
Photometric::Photometric(Photometric&&) noexcept = default;
Photometric& Photometric::operator=(Photometric&&) noexcept = default;

namespace {

PhotometricLoss loss_of(double l1_sum, double ssim_sum, double counted, double lambda) {
  if (counted == 0) return {0.0, 1.0, 0.0};  // nothing to compare
  const double samples = 3.0 * counted, l1 = l1_sum / samples, ssim = ssim_sum / samples;
  return {l1, ssim, (1.0 - lambda) * l1 + lambda * (1.0 - ssim)};
}

PhotometricLoss loss_of(const cuda::LossTotals& totals) {
  return loss_of(totals.l1, totals.ssim, totals.counted, totals.lambda_dssim);
}

void check_images(std::span<const float> render, const TruthImage& truth, float lambda_dssim,
                  std::span<float> gradient) {
  SPLATBOOST_CHECK(truth.width > 0 && truth.height > 0, "truth.width and truth.height must be above 0");
  const auto width = static_cast<std::size_t>(truth.width), height = static_cast<std::size_t>(truth.height);
  const std::size_t pixels = width * height;
  SPLATBOOST_CHECK(truth.color.size() == 3 * pixels, "truth.color must be [3,H,W]");
  SPLATBOOST_CHECK(truth.valid.empty() || truth.valid.size() == pixels, "truth.valid must be empty or [H,W]");
  SPLATBOOST_CHECK(render.size() == 3 * pixels, "render must be [3,H,W] of the truth's size");
  SPLATBOOST_CHECK(gradient.empty() || gradient.size() == 3 * pixels, "gradient must be empty or [3,H,W]");
  SPLATBOOST_CHECK(lambda_dssim >= 0.0f && lambda_dssim <= 1.0f, "lambda_dssim must lie in [0, 1]");
}

}  // namespace

void Photometric::State::note(const cuda::LossTotals& totals) {
  if (!newest || std::isfinite(newest->total)) newest = loss_of(totals);
}

PhotometricLoss Photometric::evaluate_ahead(std::span<const float> render, const TruthImage& truth, float lambda_dssim,
                                            std::span<float> gradient) {
  State& s = *state_;
  if (!s.device.is_cuda()) return evaluate(render, truth, lambda_dssim, gradient);
  check_images(render, truth, lambda_dssim, gradient);
  cuda::PendingLosses& losses = s.workspace->losses;
  if (losses.is_full()) s.note(losses.wait());
  cuda::photometric(render, truth, lambda_dssim, gradient, *s.workspace, s.device.stream());
  if (!s.newest) s.note(losses.wait());
  while (const std::optional<cuda::LossTotals> totals = losses.take()) s.note(*totals);
  return *s.newest;
}

PhotometricLoss Photometric::evaluate(std::span<const float> render, const TruthImage& truth, float lambda_dssim,
                                      std::span<float> gradient) {
  check_images(render, truth, lambda_dssim, gradient);
  const auto width = static_cast<std::size_t>(truth.width), height = static_cast<std::size_t>(truth.height);
  const std::size_t pixels = width * height;
  State& s = *state_;
  const auto lambda = static_cast<double>(lambda_dssim);
  if (s.device.is_cuda()) {
    cuda::PendingLosses& losses = s.workspace->losses;
    if (losses.is_full()) s.note(losses.wait());
    cuda::photometric(render, truth, lambda_dssim, gradient, *s.workspace, s.device.stream());
    s.device.stream().synchronize();
    while (const std::optional<cuda::LossTotals> totals = losses.take()) s.note(*totals);
    const PhotometricLoss loss = *s.newest;
    if (!std::isfinite(loss.total)) s.newest.reset();  // it has been reported
    return loss;
  }

  std::size_t counted = pixels;
  if (!truth.valid.empty()) {
    counted = static_cast<std::size_t>(
        std::count_if(truth.valid.begin(), truth.valid.end(), [](std::uint8_t v) { return v != 0; }));
  }
  if (counted == 0) {
    std::fill(gradient.begin(), gradient.end(), 0.0f);
    return loss_of(0, 0, 0, lambda);
  }
  const double samples = 3.0 * static_cast<double>(counted);

  const Blocks blocks{width, height};
  s.sums.resize(blocks.count());
  const auto job_of = [&](std::size_t channel) {
    PhotometricJob job;
    job.width = width;
    job.height = height;
    job.render = render.data() + channel * pixels;
    job.truth = truth.color.data() + channel * pixels;
    job.valid = truth.valid.empty() ? nullptr : truth.valid.data();
    job.gradient = gradient.empty() ? nullptr : gradient.data() + channel * pixels;
    job.l1_weight = static_cast<float>((1.0 - static_cast<double>(lambda_dssim)) / samples);
    job.ssim_weight = static_cast<float>(-static_cast<double>(lambda_dssim) / samples);
    return job;
  };
  s.device.threads().for_range(blocks.count(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      HWY_DYNAMIC_DISPATCH(photometric_block)(job_of(blocks.channel(i)), blocks.range(i), s.sums[i]);
    }
  });
  double l1 = 0, ssim = 0;
  for (const PhotometricSums& sum : s.sums) {
    l1 += sum.l1;
    ssim += sum.ssim;
  }
  return loss_of(l1, ssim, static_cast<double>(counted), lambda);
}

}  // namespace splatboost
#endif  // HWY_ONCE
