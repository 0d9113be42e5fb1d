// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "projection/frame.h"
#include "rasterizer/tile_images.h"
#include "splatboost/gaussian_planes.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "rasterizer/blend_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "rasterizer/splat_rows-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

std::size_t column_blocks() { return blocks_of_columns(); }

inline constexpr int kAnyExtra = kMaxFeatures + 1;

/// Blends one tile. @param image [4 + X, 256] colour over the background, alpha, extra channels
/// @tparam kColor whether colour is blended; otherwise its planes are not written
/// @tparam kExtra 0, kPlaneChannels (loops are unrolled for planes), or kAnyExtra: the number is that of the frame
template <bool kColor, int kExtra>
void blend_tile(Frame& frame, std::size_t tile, float* HWY_RESTRICT image) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int blocks = kTileSize / lanes;
  const int extra = kExtra == kAnyExtra ? frame.extra_channels() : kExtra;
  constexpr int kFirstExtra = kColor ? 4 : 1;  // planes of a row: transmittance, colour, extra channels
  TileRows<kFirstExtra + kExtra> pixels(frame, tile);

  const std::uint32_t begin = frame.tile_begin[tile], end = frame.tile_begin[tile + 1];
  std::uint32_t at = begin;
  std::uint32_t open[kMaxBlocks];
  while (at < end) {
    std::uint32_t left = 0;
    for (int b = 0; b < blocks; ++b) left |= open[b] = pixels.open_rows(b * lanes);
    if (left == 0) break;
    const std::uint32_t batch_end = std::min(at + kBatch, end);
    std::uint16_t* const rows_of = frame.entry_rows.data();
    for (std::uint32_t e = at; e < batch_end; ++e) {
      prefetch_record(frame, e, end);
      const BlendRecord& splat = frame.records[frame.entries[e].primitive];
      for (int b = 0; b < blocks; ++b) {
        const float x = static_cast<float>(pixels.x0 + b * lanes) + 0.5f;
        rows_of[e * static_cast<std::size_t>(blocks) + static_cast<std::size_t>(b)] = static_cast<std::uint16_t>(
            open[b] & rows_in_reach(splat, pixels.first_y, x, x + static_cast<float>(lanes - 1)));
      }
    }
    const std::uint16_t* found = rows_of + at * static_cast<std::size_t>(blocks);
    for (std::uint32_t e = at; e < batch_end; ++e) {
      const std::uint32_t gaussian = frame.entries[e].primitive;
      const BlendRecord& splat = frame.records[gaussian];
      const Vec red = hn::Set(d, splat.red), green = hn::Set(d, splat.green), blue = hn::Set(d, splat.blue);
      const float* channels = frame.channels.data() + gaussian * static_cast<std::size_t>(extra);
      const RowOffsets offsets(splat, pixels.first_y);
      for (int b = 0; b < blocks; ++b) {
        const std::uint32_t mask = *found++;
        if (mask == 0) continue;
        const Columns columns(splat, pixels.x0 + b * lanes);
        const RowRange rows(mask);
        float* at_pair = pixels.at(rows.first, b * lanes);
        for (int row = rows.first; row <= rows.last; row += 2, at_pair += 2 * pixels.kStride) {
          for (int k = 0; k < 2; ++k) {
            float* const at_row = at_pair + k * pixels.kStride;
            const RowStep step = step_row(columns, offsets.dy[row + k], at_row);
            const Vec weight = hn::IfThenElseZero(step.open, hn::Mul(step.before, step.alpha));
            const auto add = [&](float* plane, Vec value)
                                 HWY_ATTR { hn::Store(hn::MulAdd(weight, value, hn::Load(d, plane)), d, plane); };
            if (kColor) {
              add(at_row + kTileSize, red);
              add(at_row + 2 * kTileSize, green);
              add(at_row + 3 * kTileSize, blue);
            }
            for (int c = 0; c < extra; ++c) add(at_row + (kFirstExtra + c) * kTileSize, hn::Set(d, channels[c]));
          }
        }
      }
    }
    at = batch_end;
  }
  frame.tile_stop[tile] = at - begin;

  const glm::vec3 background = frame.options.background;
  for (int pixel = 0; pixel < kPixels; pixel += lanes) {
    const float* const state = pixels.at(pixel / kTileSize, pixel % kTileSize);
    const Vec rest = hn::Abs(hn::Load(d, state));
    for (int c = 0; kColor && c < 3; ++c) {
      const Vec blended = hn::Load(d, state + (1 + c) * kTileSize);
      hn::Store(hn::MulAdd(rest, hn::Set(d, background[c]), blended), d, image + c * kPixels + pixel);
    }
    hn::Store(hn::Sub(hn::Set(d, 1.0f), rest), d, image + 3 * kPixels + pixel);
    for (int c = 0; c < extra; ++c) {
      hn::Store(hn::Load(d, state + (kFirstExtra + c) * kTileSize), d, image + (4 + c) * kPixels + pixel);
    }
  }
}

template <bool kColor>
void blend_tile_of(Frame& frame, std::size_t tile, float* image) {
  const int extra = frame.extra_channels();
  if (extra == 0) return blend_tile<kColor, 0>(frame, tile, image);
  extra == kPlaneChannels ? blend_tile<kColor, kPlaneChannels>(frame, tile, image)
                          : blend_tile<kColor, kAnyExtra>(frame, tile, image);
}

void blend_tile_any(Frame& frame, std::size_t tile, float* image) {
  frame.color ? blend_tile_of<true>(frame, tile, image) : blend_tile_of<false>(frame, tile, image);
}

/// Slots are not contiguous: prefetch their cache lines before they are written.
HWY_INLINE void prefetch_moments(Frame& frame, std::uint32_t at, std::uint32_t end) {
  constexpr std::uint32_t kAhead = 8;
  if (at + kAhead < end) __builtin_prefetch(&frame.entry_moments[frame.entries[at + kAhead].slot], 1);
}

/// Moments of a tile's entries, front to back with the transmittance recomputed.
/// @param image [4 + X, 256] result of blend_tile
/// @param upstream [4 + X, 256] gradients of image; not used where nothing was blended
/// @tparam kColor,kExtra as for blend_tile; false and 0 if colour or the extra channels have no gradient
template <bool kAbsolute, bool kColor, int kExtra>
void blend_tile_backward(Frame& frame, std::size_t tile, const float* HWY_RESTRICT image,
                         const float* HWY_RESTRICT upstream) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int blocks = kTileSize / lanes;
  const int extra = kExtra == kAnyExtra ? frame.extra_channels() : kExtra;
  const int features = frame.features;
  // Planes of a row: transmittance; gradient · (contribution to the image of the splats behind the current one and of
  // the background); upstream gradients of colour, and of alpha and the extra channels.
  constexpr int kFirst = kColor ? 0 : 3;  // first plane of the image that has a gradient
  constexpr int kBehind = kTileSize, kUpstream = 2 * kTileSize;
  TileRows<(kExtra == 0 ? 5 : 6 + kExtra) - kFirst> pixels(frame, tile);
  for (int pixel = 0; pixel < kPixels; pixel += lanes) {
    float* const state = pixels.at(pixel / kTileSize, pixel % kTileSize);
    const Mask covered = hn::Gt(hn::Load(d, image + 3 * kPixels + pixel), hn::Zero(d));
    Vec sum = hn::Zero(d);
    for (int c = kFirst; c < (kExtra == 0 ? 3 : 4 + extra); ++c) {
      const Vec g = hn::IfThenElseZero(covered, hn::Load(d, upstream + c * kPixels + pixel));
      sum = hn::MulAdd(hn::Load(d, image + c * kPixels + pixel), g, sum);
      hn::Store(g, d, state + kUpstream + (c - kFirst) * kTileSize);
    }
    hn::Store(sum, d, state + kBehind);
  }

  const std::uint32_t begin = frame.tile_begin[tile], end = frame.tile_begin[tile + 1];
  const std::uint32_t stop = begin + frame.tile_stop[tile];
  const std::uint16_t* reached_rows = frame.entry_rows.data() + begin * static_cast<std::size_t>(blocks);
  for (std::uint32_t at = begin; at < stop; ++at) {
    prefetch_record(frame, at, stop);
    prefetch_moments(frame, at, stop);
    const std::uint32_t gaussian = frame.entries[at].primitive;
    const BlendRecord& splat = frame.records[gaussian];
    const float* channels = frame.channels.data() + gaussian * static_cast<std::size_t>(frame.extra_channels());
    const Vec own_red = hn::Set(d, splat.red), own_green = hn::Set(d, splat.green), own_blue = hn::Set(d, splat.blue);
    Vec channel_sums[kExtra + 1];
    for (int c = 0; c < extra; ++c) channel_sums[c] = hn::Zero(d);
    const RowOffsets offsets(splat, pixels.first_y);
    Vec s_sum = hn::Zero(d), s_x = hn::Zero(d), s_y = hn::Zero(d);
    Vec s_xx = hn::Zero(d), s_xy = hn::Zero(d), s_yy = hn::Zero(d);
    Vec abs_x = hn::Zero(d), abs_y = hn::Zero(d);
    Vec red = hn::Zero(d), green = hn::Zero(d), blue = hn::Zero(d);
    for (int b = 0; b < blocks; ++b) {
      const std::uint32_t mask = *reached_rows++;
      if (mask == 0) continue;
      const Columns columns(splat, pixels.x0 + b * lanes);
      const Vec slope_x = hn::Mul(columns.dx, hn::Set(d, 2.0f * splat.quadratic_xx));
      const Vec slope_xy = hn::Set(d, splat.quadratic_xy), slope_yy = hn::Set(d, 2.0f * splat.quadratic_yy);
      Vec column_s = hn::Zero(d), column_sy = hn::Zero(d), column_syy = hn::Zero(d);
      const RowRange rows(mask);
      float* at_pair = pixels.at(rows.first, b * lanes);
      for (int row = rows.first; row <= rows.last; row += 2, at_pair += 2 * pixels.kStride) {
        for (int k = 0; k < 2; ++k) {
          float* const at_row = at_pair + k * pixels.kStride;
          const RowStep step = step_row(columns, offsets.dy[row + k], at_row);
          const float* const g_row = at_row + kUpstream;
          const Vec weight = hn::IfThenElseZero(step.open, hn::Mul(step.before, step.alpha));
          Vec along = hn::Zero(d);  // gradient · the splat's own channels
          if (kColor) {
            const Vec g_red = hn::Load(d, g_row);
            const Vec g_green = hn::Load(d, g_row + kTileSize);
            const Vec g_blue = hn::Load(d, g_row + 2 * kTileSize);
            along = hn::Mul(g_red, own_red);
            along = hn::MulAdd(g_green, own_green, along);
            along = hn::MulAdd(g_blue, own_blue, along);
            red = hn::MulAdd(weight, g_red, red);
            green = hn::MulAdd(weight, g_green, green);
            blue = hn::MulAdd(weight, g_blue, blue);
          }
          if (kExtra > 0) {
            along = hn::Add(along, hn::Load(d, g_row + (3 - kFirst) * kTileSize));  // alpha: a channel with value 1
            for (int c = 0; c < extra; ++c) {
              const Vec g = hn::Load(d, g_row + (4 - kFirst + c) * kTileSize);
              along = hn::MulAdd(g, hn::Set(d, channels[c]), along);
              channel_sums[c] = hn::MulAdd(weight, g, channel_sums[c]);
            }
          }
          const Vec gain = hn::Mul(weight, along);
          const Vec rest = hn::Sub(hn::Load(d, at_row + kBehind), gain);
          hn::Store(rest, d, at_row + kBehind);
          // s = α·dL/dα = weight·along − rest·α/(1 − α), and α/(1 − α) = weight/after; the reciprocal is refined by
          // one Newton step.
          Vec inverse = hn::ApproximateReciprocal(step.after);
          inverse = hn::Mul(inverse, hn::NegMulAdd(step.after, inverse, hn::Set(d, 2.0f)));
          const Mask moves = hn::Lt(step.alpha, hn::Set(d, kMaxAlpha));
          const Vec s = hn::IfThenElseZero(moves, hn::NegMulAdd(rest, hn::Mul(weight, inverse), gain));
          const Vec sy = hn::Mul(s, step.dy);
          column_s = hn::Add(column_s, s);
          column_sy = hn::Add(column_sy, sy);
          column_syy = hn::MulAdd(sy, step.dy, column_syy);
          if (kAbsolute) {
            const Vec size = hn::Abs(s);
            const Vec pull_x = hn::MulAdd(step.dy, slope_xy, slope_x);
            const Vec pull_y = hn::MulAdd(step.dy, slope_yy, columns.linear);
            abs_x = hn::MulAdd(size, hn::Abs(pull_x), abs_x);
            abs_y = hn::MulAdd(size, hn::Abs(pull_y), abs_y);
          }
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
    const std::size_t slot = frame.entries[at].slot;
    auto* moments = reinterpret_cast<float*>(&frame.entry_moments[slot]);
    sums_of(s_sum, s_x, s_y, s_xx, moments);
    sums_of(s_xy, s_yy, red, green, moments + 4);
    sums_of(blue, abs_x, abs_y, hn::Zero(d), moments + 8);
    float channel_gradient[kAnyExtra] = {};
    for (int c = 0; c < extra; ++c) channel_gradient[c] = sum_of(channel_sums[c]);
    if (kExtra > 0 && frame.inverse_depth) frame.entry_moments[slot].inverse_depth = channel_gradient[features];
    if (features > 0) {
      std::copy_n(channel_gradient, features,
                  frame.entry_channel_gradients.data() + static_cast<std::size_t>(features) * slot);
    }
  }
  // Entries from `stop` on were not blended at any pixel.
  for (std::uint32_t at = stop; at < end; ++at) {
    const std::size_t slot = frame.entries[at].slot;
    frame.entry_moments[slot] = EntryMoments{};
    std::fill_n(frame.entry_channel_gradients.data() + static_cast<std::size_t>(features) * slot, features, 0.0f);
  }
}

template <bool kAbsolute, bool kColor>
void blend_tile_backward_with_extra(Frame& frame, std::size_t tile, const float* image, const float* upstream) {
  frame.extra_channels() == kPlaneChannels
      ? blend_tile_backward<kAbsolute, kColor, kPlaneChannels>(frame, tile, image, upstream)
      : blend_tile_backward<kAbsolute, kColor, kAnyExtra>(frame, tile, image, upstream);
}

template <bool kAbsolute>
void blend_tile_backward_of(Frame& frame, std::size_t tile, const float* image, const float* upstream, bool color,
                            bool extra) {
  if (!extra) return blend_tile_backward<kAbsolute, true, 0>(frame, tile, image, upstream);
  color ? blend_tile_backward_with_extra<kAbsolute, true>(frame, tile, image, upstream)
        : blend_tile_backward_with_extra<kAbsolute, false>(frame, tile, image, upstream);
}

/// @param color,extra whether colour, and alpha or an extra channel, have gradients: at least one of the two
void blend_tile_backward_any(Frame& frame, std::size_t tile, const float* image, const float* upstream, bool absolute,
                             bool color, bool extra) {
  absolute ? blend_tile_backward_of<true>(frame, tile, image, upstream, color, extra)
           : blend_tile_backward_of<false>(frame, tile, image, upstream, color, extra);
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost {
namespace {

HWY_EXPORT(column_blocks);
HWY_EXPORT(blend_tile_any);
HWY_EXPORT(blend_tile_backward_any);

}  // namespace

void blend(Frame& frame, const RasterImages& images, const Threads& threads) {
  const std::size_t planes = 4 + static_cast<std::size_t>(frame.extra_channels());
  const auto features = static_cast<std::size_t>(frame.features);
  frame.tile_images.ensure(frame.tiles() * planes * kTilePixels);
  frame.tile_stop.ensure(frame.tiles());
  frame.entry_rows.ensure(frame.entries.size() * HWY_DYNAMIC_DISPATCH(column_blocks)());
  threads.for_range(frame.tiles(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t tile = begin; tile < end; ++tile) {
      float* image = frame.tile_images.data() + tile * planes * kTilePixels;
      HWY_DYNAMIC_DISPATCH(blend_tile_any)(frame, tile, image);
      const TileArea area(frame, tile);
      store_planes(area, image, 3, images.color);
      store_planes(area, image + 3 * kTilePixels, 1, images.alpha);
      store_planes(area, image + 4 * kTilePixels, features, images.features);
      if (frame.inverse_depth) store_planes(area, image + (4 + features) * kTilePixels, 1, images.inverse_depth);
    }
  });
}

void blend_backward(Frame& frame, const RasterImageGradients& gradients, bool absolute, const Threads& threads) {
  const std::size_t planes = 4 + static_cast<std::size_t>(frame.extra_channels());
  const auto features = static_cast<std::size_t>(frame.features);
  frame.entry_moments.ensure(frame.entries.size());
  frame.entry_channel_gradients.ensure(frame.entries.size() * features);
  const bool color = !gradients.color.empty();
  // Without any gradient that of alpha is zero.
  const bool extra = !color || !gradients.alpha.empty() || (!gradients.features.empty() && features > 0) ||
                     (!gradients.inverse_depth.empty() && frame.inverse_depth);
  threads.for_range(frame.tiles(), 1, [&](std::size_t begin, std::size_t end) {
    alignas(64) float upstream[(4 + kMaxFeatures + 1) * kTilePixels];
    for (std::size_t tile = begin; tile < end; ++tile) {
      const TileArea area(frame, tile);
      if (color) load_planes(area, gradients.color, 3, upstream);
      if (extra) {
        load_planes(area, gradients.alpha, 1, upstream + 3 * kTilePixels);
        load_planes(area, gradients.features, features, upstream + 4 * kTilePixels);
        if (frame.inverse_depth) {
          load_planes(area, gradients.inverse_depth, 1, upstream + (4 + features) * kTilePixels);
        }
      }
      HWY_DYNAMIC_DISPATCH(blend_tile_backward_any)
      (frame, tile, frame.tile_images.data() + tile * planes * kTilePixels, upstream, absolute, color, extra);
    }
  });
}

}  // namespace splatboost
#endif  // HWY_ONCE
