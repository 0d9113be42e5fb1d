// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "frame.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "blend_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once an instruction set
#include <hwy/highway.h>

#include "splat_rows-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

/// Blends one tile. @param image [4 + X, 256] colour over the background, alpha, extra channels
void blend_tile(Frame& frame, std::size_t tile, float* HWY_RESTRICT image) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int x0 = static_cast<int>(tile % static_cast<std::size_t>(frame.tiles_x)) * kTileSize;
  const int y0 = static_cast<int>(tile / static_cast<std::size_t>(frame.tiles_x)) * kTileSize;
  const int extra = frame.extra_channels();
  alignas(64) float transmittance[kPixels];
  open_tile(frame.camera, x0, y0, transmittance);
  std::memset(image, 0, sizeof(float) * kPixels * static_cast<std::size_t>(4 + extra));
  float* extra_images = image + 4 * kPixels;

  std::uint32_t open[kTileSize];  // rows with open pixels, a block of columns each
  for (int x = 0; x < kTileSize; x += lanes) open[x / lanes] = open_rows(transmittance, x);

  const std::uint32_t begin = frame.tile_begin[tile], end = frame.tile_begin[tile + 1];
  std::uint32_t at = begin;
  for (; at < end; ++at) {
    prefetch_record(frame, at, end);
    const std::uint32_t k = frame.entries[at];
    const BlendRecord& splat = frame.records[k];
    const std::uint32_t reach = rows_in_reach(splat, y0);
    if (reach == 0) continue;
    const float* channels = frame.channels.data() + k * static_cast<std::size_t>(extra);
    bool closed = false;
    for (int x = 0; x < kTileSize; x += lanes) {
      std::uint32_t rows = reach & open[x / lanes];
      if (rows == 0) continue;
      const Columns columns(splat, x0 + x);
      bool any_saturated = false;
      for (; rows != 0; rows &= rows - 1) {
        const int row = std::countr_zero(rows);
        const int pixel = row * kTileSize + x;
        const float dy = static_cast<float>(y0 + row) + 0.5f - splat.mean_y;
        RowStep step;
        bool saturated;
        if (!advance_row(columns, dy, transmittance + pixel, step, saturated)) continue;
        any_saturated |= saturated;
        const Vec weight = hn::IfThenElseZero(step.blended, hn::Mul(step.before, step.alpha));
        float* red = image + pixel;
        hn::Store(hn::MulAdd(weight, hn::Set(d, splat.red), hn::Load(d, red)), d, red);
        float* green = red + kPixels;
        hn::Store(hn::MulAdd(weight, hn::Set(d, splat.green), hn::Load(d, green)), d, green);
        float* blue = green + kPixels;
        hn::Store(hn::MulAdd(weight, hn::Set(d, splat.blue), hn::Load(d, blue)), d, blue);
        for (int c = 0; c < extra; ++c) {
          float* channel = extra_images + c * kPixels + pixel;
          hn::Store(hn::MulAdd(weight, hn::Set(d, channels[c]), hn::Load(d, channel)), d, channel);
        }
      }
      if (any_saturated) {
        open[x / lanes] = open_rows(transmittance, x);
        closed = true;
      }
    }
    if (closed) {
      std::uint32_t left = 0;
      for (int x = 0; x < kTileSize; x += lanes) left |= open[x / lanes];
      if (left == 0) {
        ++at;
        break;
      }
    }
  }
  frame.tile_stop[tile] = at - begin;

  const glm::vec3 background = frame.options.background;
  for (int pixel = 0; pixel < kPixels; pixel += lanes) {
    const Vec rest = hn::Abs(hn::Load(d, transmittance + pixel));
    for (int c = 0; c < 3; ++c) {
      float* plane = image + c * kPixels + pixel;
      hn::Store(hn::MulAdd(rest, hn::Set(d, background[c]), hn::Load(d, plane)), d, plane);
    }
    hn::Store(hn::Sub(hn::Set(d, 1.0f), rest), d, image + 3 * kPixels + pixel);
  }
}

/// Sum over the lanes.
HWY_INLINE float sum_of(Vec v) { return hn::GetLane(hn::SumOfLanes(Lanes(), v)); }

/// Sums over the lanes of four vectors at once, half the work of four single ones: the vectors are woven into one
/// whose every 128-bit block holds a part of each sum, and blocks are added.
HWY_INLINE void sums_of(Vec a, Vec b, Vec c, Vec e, float* HWY_RESTRICT sums) {
#if HWY_TARGET == HWY_SCALAR
  sums[0] = sum_of(a);
  sums[1] = sum_of(b);
  sums[2] = sum_of(c);
  sums[3] = sum_of(e);
#else
  const Lanes d;
  const hn::Repartition<std::uint64_t, Lanes> wide;
  const Vec ab = hn::Add(hn::InterleaveLower(d, a, b), hn::InterleaveUpper(d, a, b));
  const Vec ce = hn::Add(hn::InterleaveLower(d, c, e), hn::InterleaveUpper(d, c, e));
  const auto ab2 = hn::BitCast(wide, ab), ce2 = hn::BitCast(wide, ce);
  const Vec blocks =
      hn::Add(hn::BitCast(d, hn::InterleaveLower(wide, ab2, ce2)), hn::BitCast(d, hn::InterleaveUpper(wide, ab2, ce2)));
  alignas(64) float parts[kTileSize];
  hn::Store(blocks, d, parts);
  const hn::CappedTag<float, 4> four;
  auto sum = hn::Load(four, parts);
  for (std::size_t i = 4; i < hn::Lanes(d); i += 4) sum = hn::Add(sum, hn::Load(four, parts + i));
  hn::StoreU(sum, four, sums);
#endif
}

/// Gradients of a tile's entries, front to back with the transmittance recomputed.
/// @param image [4 + X, 256] what blend_tile made
/// @param upstream [4 + X, 256] gradients of it
template <bool kAbsolute, bool kExtra>
void blend_tile_backward(Frame& frame, std::size_t tile, const float* HWY_RESTRICT image,
                         const float* HWY_RESTRICT upstream) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int x0 = static_cast<int>(tile % static_cast<std::size_t>(frame.tiles_x)) * kTileSize;
  const int y0 = static_cast<int>(tile / static_cast<std::size_t>(frame.tiles_x)) * kTileSize;
  const int extra = kExtra ? frame.extra_channels() : 0;
  const int features = frame.features;
  alignas(64) float transmittance[kPixels];
  open_tile(frame.camera, x0, y0, transmittance);

  // Per pixel, gradient · (what the splats behind the current one, and the background, add to the image).
  alignas(64) float behind[kPixels];
  for (int pixel = 0; pixel < kPixels; pixel += lanes) {
    Vec sum = hn::Zero(d);
    for (int c = 0; c < 3; ++c) {
      sum = hn::MulAdd(hn::Load(d, image + c * kPixels + pixel), hn::Load(d, upstream + c * kPixels + pixel), sum);
    }
    if (kExtra) {
      for (int c = 3; c < 4 + extra; ++c) {
        sum = hn::MulAdd(hn::Load(d, image + c * kPixels + pixel), hn::Load(d, upstream + c * kPixels + pixel), sum);
      }
    }
    hn::Store(sum, d, behind + pixel);
  }

  const std::uint32_t begin = frame.tile_begin[tile], end = frame.tile_begin[tile + 1];
  const std::uint32_t stop = begin + frame.tile_stop[tile];
  for (std::uint32_t at = begin; at < stop; ++at) {
    prefetch_record(frame, at, stop);
    const std::uint32_t k = frame.entries[at];
    const BlendRecord& splat = frame.records[k];
    const float* channels = frame.channels.data() + k * static_cast<std::size_t>(frame.extra_channels());
    EntryGradient gradient{};
    float channel_gradient[kMaxFeatures + 1] = {};

    const std::uint32_t reach = rows_in_reach(splat, y0);
    // s = α·dL/dα; the moments of s give mean, conic and opacity.
    Vec s_sum = hn::Zero(d), s_x = hn::Zero(d), s_y = hn::Zero(d);
    Vec s_xx = hn::Zero(d), s_xy = hn::Zero(d), s_yy = hn::Zero(d);
    Vec abs_x = hn::Zero(d), abs_y = hn::Zero(d);
    Vec red = hn::Zero(d), green = hn::Zero(d), blue = hn::Zero(d);
    bool touched = false;
    for (int x = 0; reach != 0 && x < kTileSize; x += lanes) {
      const Columns columns(splat, x0 + x);
      Vec column_s = hn::Zero(d), column_sy = hn::Zero(d), column_syy = hn::Zero(d);
      for (std::uint32_t rows = reach; rows != 0; rows &= rows - 1) {
        const int row = std::countr_zero(rows);
        const int pixel = row * kTileSize + x;
        const float dy = static_cast<float>(y0 + row) + 0.5f - splat.mean_y;
        RowStep step;
        bool saturated;
        if (!advance_row(columns, dy, transmittance + pixel, step, saturated)) continue;
        touched = true;
        const Vec g_red = hn::Load(d, upstream + pixel);
        const Vec g_green = hn::Load(d, upstream + kPixels + pixel);
        const Vec g_blue = hn::Load(d, upstream + 2 * kPixels + pixel);
        Vec along = hn::Mul(g_red, hn::Set(d, splat.red));  // gradient · the splat's own colour
        along = hn::MulAdd(g_green, hn::Set(d, splat.green), along);
        along = hn::MulAdd(g_blue, hn::Set(d, splat.blue), along);
        const Vec weight = hn::IfThenElseZero(step.blended, hn::Mul(step.before, step.alpha));
        red = hn::MulAdd(weight, g_red, red);
        green = hn::MulAdd(weight, g_green, green);
        blue = hn::MulAdd(weight, g_blue, blue);
        if (kExtra) {
          along = hn::Add(along, hn::Load(d, upstream + 3 * kPixels + pixel));  // alpha: a channel that is 1
          for (int c = 0; c < extra; ++c) {
            const Vec g = hn::Load(d, upstream + (4 + c) * kPixels + pixel);
            along = hn::MulAdd(g, hn::Set(d, channels[c]), along);
            channel_gradient[c] += sum_of(hn::Mul(weight, g));
          }
        }
        const Vec rest = hn::NegMulAdd(weight, along, hn::Load(d, behind + pixel));
        hn::Store(rest, d, behind + pixel);
        // dL/dα = T·along − rest/(1 − α); the reciprocal is refined once by Newton.
        const Vec transparency = hn::Sub(hn::Set(d, 1.0f), step.alpha);
        Vec inverse = hn::ApproximateReciprocal(transparency);
        inverse = hn::Mul(inverse, hn::NegMulAdd(transparency, inverse, hn::Set(d, 2.0f)));
        const Vec g_alpha = hn::NegMulAdd(rest, inverse, hn::Mul(step.before, along));
        const Mask moves = hn::And(step.blended, hn::Le(step.unclamped, hn::Set(d, kMaxAlpha)));
        const Vec s = hn::IfThenElseZero(moves, hn::Mul(step.alpha, g_alpha));
        const Vec y = hn::Set(d, dy);
        const Vec sy = hn::Mul(s, y);
        column_s = hn::Add(column_s, s);
        column_sy = hn::Add(column_sy, sy);
        column_syy = hn::MulAdd(sy, y, column_syy);
        if (kAbsolute) {
          const Vec size = hn::Abs(s);
          const Vec pull_x = hn::MulAdd(columns.dx, hn::Set(d, splat.conic_xx), hn::Set(d, splat.conic_xy * dy));
          const Vec pull_y = hn::MulAdd(columns.dx, hn::Set(d, splat.conic_xy), hn::Set(d, splat.conic_yy * dy));
          abs_x = hn::MulAdd(size, hn::Abs(pull_x), abs_x);
          abs_y = hn::MulAdd(size, hn::Abs(pull_y), abs_y);
        }
      }
      const Vec column_sx = hn::Mul(column_s, columns.dx);
      s_sum = hn::Add(s_sum, column_s);
      s_x = hn::Add(s_x, column_sx);
      s_y = hn::Add(s_y, column_sy);
      s_xx = hn::MulAdd(column_sx, columns.dx, s_xx);
      s_xy = hn::MulAdd(column_sy, columns.dx, s_xy);
      s_yy = hn::Add(s_yy, column_syy);
    }
    if (touched) {
      float moments[4], squares[4], others[4];
      sums_of(s_sum, s_x, s_y, s_xx, moments);
      sums_of(s_xy, s_yy, red, green, squares);
      sums_of(blue, abs_x, abs_y, hn::Zero(d), others);
      gradient.mean_x = splat.conic_xx * moments[1] + splat.conic_xy * moments[2];
      gradient.mean_y = splat.conic_xy * moments[1] + splat.conic_yy * moments[2];
      gradient.conic_xx = -0.5f * moments[3];
      gradient.conic_xy = -squares[0];
      gradient.conic_yy = -0.5f * squares[1];
      gradient.opacity = moments[0] / splat.opacity;
      gradient.red = squares[2];
      gradient.green = squares[3];
      gradient.blue = others[0];
      if (kAbsolute) {
        gradient.mean_abs_x = others[1];
        gradient.mean_abs_y = others[2];
      }
      if (kExtra && frame.inverse_depth) gradient.inverse_depth = channel_gradient[features];
    }
    const std::size_t slot = frame.slots[at];
    frame.entry_gradients[slot] = gradient;
    if (features > 0) {
      std::copy_n(channel_gradient, features,
                  frame.entry_channel_gradients.data() + static_cast<std::size_t>(features) * slot);
    }
  }
  // Entries behind the last open pixel moved nothing.
  for (std::uint32_t at = stop; at < end; ++at) {
    const std::size_t slot = frame.slots[at];
    frame.entry_gradients[slot] = EntryGradient{};
    std::fill_n(frame.entry_channel_gradients.data() + static_cast<std::size_t>(features) * slot, features, 0.0f);
  }
}

void blend_tile_backward_any(Frame& frame, std::size_t tile, const float* image, const float* upstream, bool absolute,
                             bool extra) {
  if (absolute) {
    extra ? blend_tile_backward<true, true>(frame, tile, image, upstream)
          : blend_tile_backward<true, false>(frame, tile, image, upstream);
  } else {
    extra ? blend_tile_backward<false, true>(frame, tile, image, upstream)
          : blend_tile_backward<false, false>(frame, tile, image, upstream);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost {
namespace {

HWY_EXPORT(blend_tile);
HWY_EXPORT(blend_tile_backward_any);

constexpr std::size_t kTilePixels = kTileSize * kTileSize;

/// The part of an image that a tile covers.
struct TileArea {
  std::size_t x0, y0, width, height;
  std::size_t image_width, image_pixels;
  TileArea(const Frame& frame, std::size_t tile) {
    const auto columns = static_cast<std::size_t>(frame.tiles_x);
    image_width = static_cast<std::size_t>(frame.camera.width);
    const auto image_height = static_cast<std::size_t>(frame.camera.height);
    image_pixels = image_width * image_height;
    x0 = tile % columns * kTileSize;
    y0 = tile / columns * kTileSize;
    width = std::min<std::size_t>(kTileSize, image_width - x0);
    height = std::min<std::size_t>(kTileSize, image_height - y0);
  }
  std::size_t row(std::size_t plane, std::size_t y) const { return plane * image_pixels + (y0 + y) * image_width + x0; }
};

void store_planes(const TileArea& area, const float* tile, std::size_t planes, std::span<float> image) {
  if (image.empty()) return;
  for (std::size_t c = 0; c < planes; ++c) {
    for (std::size_t y = 0; y < area.height; ++y) {
      std::memcpy(image.data() + area.row(c, y), tile + c * kTilePixels + y * kTileSize, area.width * sizeof(float));
    }
  }
}

void load_planes(const TileArea& area, std::span<const float> image, std::size_t planes, float* tile) {
  std::memset(tile, 0, planes * kTilePixels * sizeof(float));
  if (image.empty()) return;
  for (std::size_t c = 0; c < planes; ++c) {
    for (std::size_t y = 0; y < area.height; ++y) {
      std::memcpy(tile + c * kTilePixels + y * kTileSize, image.data() + area.row(c, y), area.width * sizeof(float));
    }
  }
}

}  // namespace

void blend(Frame& frame, const RasterImages& images, Threads& threads) {
  const std::size_t planes = 4 + static_cast<std::size_t>(frame.extra_channels());
  const auto features = static_cast<std::size_t>(frame.features);
  frame.tile_images.ensure(frame.tiles() * planes * kTilePixels);
  frame.tile_stop.ensure(frame.tiles());
  threads.for_range(frame.tiles(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t tile = begin; tile < end; ++tile) {
      float* image = frame.tile_images.data() + tile * planes * kTilePixels;
      HWY_DYNAMIC_DISPATCH(blend_tile)(frame, tile, image);
      const TileArea area(frame, tile);
      store_planes(area, image, 3, images.color);
      store_planes(area, image + 3 * kTilePixels, 1, images.alpha);
      store_planes(area, image + 4 * kTilePixels, features, images.features);
      if (frame.inverse_depth) store_planes(area, image + (4 + features) * kTilePixels, 1, images.inverse_depth);
    }
  });
}

void blend_backward(Frame& frame, const RasterImageGradients& gradients, bool absolute, Threads& threads) {
  const std::size_t planes = 4 + static_cast<std::size_t>(frame.extra_channels());
  const auto features = static_cast<std::size_t>(frame.features);
  frame.entry_gradients.ensure(frame.entries.size());
  frame.entry_channel_gradients.ensure(frame.entries.size() * features);
  const bool extra = !gradients.alpha.empty() || (!gradients.features.empty() && features > 0) ||
                     (!gradients.inverse_depth.empty() && frame.inverse_depth);
  threads.for_range(frame.tiles(), 1, [&](std::size_t begin, std::size_t end) {
    alignas(64) float upstream[(4 + kMaxFeatures + 1) * kTilePixels];
    for (std::size_t tile = begin; tile < end; ++tile) {
      const TileArea area(frame, tile);
      load_planes(area, gradients.color, 3, upstream);
      if (extra) {
        load_planes(area, gradients.alpha, 1, upstream + 3 * kTilePixels);
        load_planes(area, gradients.features, features, upstream + 4 * kTilePixels);
        if (frame.inverse_depth) {
          load_planes(area, gradients.inverse_depth, 1, upstream + (4 + features) * kTilePixels);
        }
      }
      HWY_DYNAMIC_DISPATCH(blend_tile_backward_any)
      (frame, tile, frame.tile_images.data() + tile * planes * kTilePixels, upstream, absolute, extra);
    }
  });
}

}  // namespace splatboost
#endif  // HWY_ONCE
