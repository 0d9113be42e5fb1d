// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstring>

#include "convexes/convex_frame.h"
#include "rasterizer/tile_images.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "convexes/blend_convexes_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "convexes/convex_rows-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

std::size_t convex_column_blocks() { return blocks_of_columns(); }

/// Visits the rows of a block of columns that a convex may reach, kRowsAtATime at a time.
template <int kEdges, class Visit>
HWY_INLINE void for_rows(const ConvexRecord& convex, TileRows<4>& pixels, std::uint32_t mask, int x,
                         const Visit& visit) {
  const EdgeColumns<kEdges> columns(convex, pixels.x0 + x);
  const RowRange rows(mask);
  for (int row = rows.first; row <= rows.last; row += kRowsAtATime) visit(columns, row);
}

/// Blends one tile. @param image [4, 256] colour over the background, alpha
void blend_convex_tile(ConvexFrame& frame, std::size_t tile, float* HWY_RESTRICT image) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const int blocks = kTileSize / lanes;
  TileRows<4> pixels(frame, tile);  // transmittance, colour

  const std::uint32_t begin = frame.tile_begin[tile], end = frame.tile_begin[tile + 1];
  std::uint32_t at = begin;
  std::uint32_t open[kMaxBlocks];
  while (at < end) {
    std::uint32_t left = 0;
    for (int b = 0; b < blocks; ++b) left |= open[b] = pixels.open_rows(b * lanes);
    if (left == 0) break;
    const std::uint32_t batch_end = std::min(at + kBatch, end);
    for (; at < batch_end; ++at) {
      prefetch_convex(frame, at, end);
      const ConvexRecord& convex = frame.records[frame.entries[at].primitive];
      const Vec red = hn::Set(d, convex.red), green = hn::Set(d, convex.green), blue = hn::Set(d, convex.blue);
      std::uint16_t* const rows_of = frame.entry_rows.data() + at * static_cast<std::size_t>(blocks);
      for (int b = 0; b < blocks; ++b) {
        const float x = static_cast<float>(pixels.x0 + b * lanes) + 0.5f;
        const std::uint32_t mask = open[b] & rows_near(convex, pixels.first_y, x, x + static_cast<float>(lanes - 1));
        rows_of[b] = static_cast<std::uint16_t>(mask);
        if (mask == 0) continue;
        with_edges(convex, [&](auto edges) HWY_ATTR {
          constexpr int kEdges = decltype(edges)::value;
          for_rows<kEdges>(convex, pixels, mask, b * lanes, [&](const EdgeColumns<kEdges>& columns, int row) HWY_ATTR {
            float* const at_row = pixels.at(row, b * lanes);
            ConvexStep<kEdges> steps[kRowsAtATime];
            const float y = pixels.first_y + static_cast<float>(row);
            if (!step_convex(convex, columns, y, at_row, pixels.kStride, steps)) return;
            for (int r = 0; r < kRowsAtATime; ++r) {
              const Vec weight = hn::IfThenElseZero(steps[r].open, hn::Mul(steps[r].before, steps[r].alpha));
              float* plane = at_row + r * pixels.kStride + kTileSize;
              hn::Store(hn::MulAdd(weight, red, hn::Load(d, plane)), d, plane);
              plane += kTileSize;
              hn::Store(hn::MulAdd(weight, green, hn::Load(d, plane)), d, plane);
              plane += kTileSize;
              hn::Store(hn::MulAdd(weight, blue, hn::Load(d, plane)), d, plane);
            }
          });
        });
      }
    }
  }
  frame.tile_stop[tile] = at - begin;

  const glm::vec3 background = frame.options.background;
  for (int pixel = 0; pixel < kPixels; pixel += lanes) {
    const float* const state = pixels.at(pixel / kTileSize, pixel % kTileSize);
    const Vec rest = hn::Abs(hn::Load(d, state));
    for (int c = 0; c < 3; ++c) {
      const Vec blended = hn::Load(d, state + (1 + c) * kTileSize);
      hn::Store(hn::MulAdd(rest, hn::Set(d, background[c]), blended), d, image + c * kPixels + pixel);
    }
    hn::Store(hn::Sub(hn::Set(d, 1.0f), rest), d, image + 3 * kPixels + pixel);
  }
}

/// Sums of one entry, with one partial sum per lane.
template <int kEdges>
struct EntrySums {
  Vec red, green, blue, s, steepness, steepness_abs;
  Vec edge[kEdges], edge_x[kEdges], edge_y[kEdges];

  HWY_INLINE EntrySums() {
    const Lanes d;
    red = green = blue = s = steepness = steepness_abs = hn::Zero(d);
    for (int k = 0; k < kEdges; ++k) edge[k] = edge_x[k] = edge_y[k] = hn::Zero(d);
  }
  HWY_INLINE void store(ConvexMoments& moments) const {
    const Vec zero = hn::Zero(Lanes());
    auto* const to = reinterpret_cast<float*>(&moments);
    sums_of(red, green, blue, s, to);
    sums_of(steepness, steepness_abs, zero, zero, to + 4);
    for (int k = 0; k < kMaxConvexPoints; ++k) {
      float sums[4] = {};
      if (k < kEdges) sums_of(edge[k], edge_x[k], edge_y[k], zero, sums);
      std::copy_n(sums, 3, moments.edge[k]);
    }
  }
};

/// Sums of one entry of a tile. Planes of a row: transmittance; gradient · (contribution to the image of the convexes
/// behind the current one and of the background); upstream gradients of colour, and of alpha.
template <int kEdges>
HWY_INLINE void entry_backward(const ConvexRecord& convex, TileRows<6>& pixels, const std::uint16_t* reached_rows,
                               ConvexMoments& moments) {
  constexpr int kBehind = kTileSize, kUpstream = 2 * kTileSize;
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const Vec own_red = hn::Set(d, convex.red), own_green = hn::Set(d, convex.green), own_blue = hn::Set(d, convex.blue);
  EntrySums<kEdges> sums;
  for (int x = 0; x < kTileSize; x += lanes) {
    const std::uint32_t mask = *reached_rows++;
    if (mask == 0) continue;
    const EdgeColumns<kEdges> columns(convex, pixels.x0 + x);
    Vec column_edge[kEdges];
    for (int k = 0; k < kEdges; ++k) column_edge[k] = hn::Zero(d);
    const RowRange rows(mask);
    for (int first = rows.first; first <= rows.last; first += kRowsAtATime) {
      ConvexStep<kEdges> steps[kRowsAtATime];
      const float y = pixels.first_y + static_cast<float>(first);
      if (!step_convex(convex, columns, y, pixels.at(first, x), pixels.kStride, steps)) continue;
      Vec us[kRowsAtATime];
      Mask any_u;
      for (int r = 0; r < kRowsAtATime; ++r) {
        const ConvexStep<kEdges>& step = steps[r];
        float* const at_row = pixels.at(first + r, x);
        const float* const g_row = at_row + kUpstream;
        const Vec g_red = hn::Load(d, g_row);
        const Vec g_green = hn::Load(d, g_row + kTileSize);
        const Vec g_blue = hn::Load(d, g_row + 2 * kTileSize);
        Vec along = hn::Load(d, g_row + 3 * kTileSize);  // alpha: a channel with value 1
        along = hn::MulAdd(g_red, own_red, along);
        along = hn::MulAdd(g_green, own_green, along);
        along = hn::MulAdd(g_blue, own_blue, along);
        const Vec weight = hn::IfThenElseZero(step.open, hn::Mul(step.before, step.alpha));
        sums.red = hn::MulAdd(weight, g_red, sums.red);
        sums.green = hn::MulAdd(weight, g_green, sums.green);
        sums.blue = hn::MulAdd(weight, g_blue, sums.blue);
        const Vec gain = hn::Mul(weight, along);
        const Vec rest = hn::Sub(hn::Load(d, at_row + kBehind), gain);
        hn::Store(rest, d, at_row + kBehind);
        // s = α·dL/dα = weight·along − rest·α/(1 − α), and α/(1 − α) = weight/after.
        Vec inverse = hn::ApproximateReciprocal(step.after);
        inverse = hn::Mul(inverse, hn::NegMulAdd(step.after, inverse, hn::Set(d, 2.0f)));
        const Mask moves = hn::Lt(step.alpha, hn::Set(d, kMaxAlpha));
        const Vec s =
            hn::IfThenElseZero(hn::And(moves, step.open), hn::NegMulAdd(rest, hn::Mul(weight, inverse), gain));
        sums.s = hn::Add(sums.s, s);
        // u = −s·(1 − I): zero where I saturates at 1.
        const Vec u = hn::MulSub(s, step.inside, s);
        const Vec by_phi = hn::Mul(u, step.phi);
        sums.steepness = hn::Add(sums.steepness, by_phi);
        sums.steepness_abs = hn::Add(sums.steepness_abs, hn::Abs(by_phi));
        const Mask moves_u = hn::Ne(u, hn::Zero(d));
        any_u = r == 0 ? moves_u : hn::Or(any_u, moves_u);
        us[r] = u;
      }
      if (hn::AllFalse(d, any_u)) continue;
      Vec per_part[kRowsAtATime];
      for (int r = 0; r < kRowsAtATime; ++r) per_part[r] = hn::Div(us[r], steps[r].sum);
      for (int k = 0; k < kEdges; ++k) {
        Vec column = column_edge[k], in_y = sums.edge_y[k];
        for (int r = 0; r < kRowsAtATime; ++r) {
          const Vec part = hn::Mul(per_part[r], steps[r].part[k]);
          column = hn::Add(column, part);
          in_y = hn::MulAdd(part, steps[r].dy, in_y);
        }
        column_edge[k] = column;
        sums.edge_y[k] = in_y;
      }
    }
    for (int k = 0; k < kEdges; ++k) {
      sums.edge[k] = hn::Add(sums.edge[k], column_edge[k]);
      sums.edge_x[k] = hn::MulAdd(column_edge[k], columns.dx, sums.edge_x[k]);
    }
  }
  sums.store(moments);
}

/// Moments of a tile's entries, front to back with the transmittance recomputed.
/// @param image [4, 256] result of blend_convex_tile
/// @param upstream [4, 256] gradients of image; not used where nothing was blended
void blend_convex_tile_backward(ConvexFrame& frame, std::size_t tile, const float* HWY_RESTRICT image,
                                const float* HWY_RESTRICT upstream) {
  const Lanes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const auto blocks = static_cast<std::size_t>(kTileSize / lanes);
  TileRows<6> pixels(frame, tile);
  for (int pixel = 0; pixel < kPixels; pixel += lanes) {
    float* const state = pixels.at(pixel / kTileSize, pixel % kTileSize);
    const Mask covered = hn::Gt(hn::Load(d, image + 3 * kPixels + pixel), hn::Zero(d));
    Vec sum = hn::Zero(d);
    for (int c = 0; c < 4; ++c) {
      const Vec g = hn::IfThenElseZero(covered, hn::Load(d, upstream + c * kPixels + pixel));
      sum = hn::MulAdd(hn::Load(d, image + c * kPixels + pixel), g, sum);
      hn::Store(g, d, state + (2 + c) * kTileSize);
    }
    hn::Store(sum, d, state + kTileSize);
  }
  const std::uint32_t begin = frame.tile_begin[tile], end = frame.tile_begin[tile + 1];
  const std::uint32_t stop = begin + frame.tile_stop[tile];
  for (std::uint32_t at = begin; at < stop; ++at) {
    prefetch_convex(frame, at, stop);
    const TileEntry entry = frame.entries[at];
    const ConvexRecord& convex = frame.records[entry.primitive];
    const std::uint16_t* const reached_rows = frame.entry_rows.data() + at * blocks;
    with_edges(convex, [&](auto edges) HWY_ATTR {
      entry_backward<decltype(edges)::value>(convex, pixels, reached_rows, frame.entry_moments[entry.slot]);
    });
  }
  // Entries from `stop` on were not blended at any pixel.
  for (std::uint32_t at = stop; at < end; ++at) frame.entry_moments[frame.entries[at].slot] = ConvexMoments{};
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost {
namespace {
HWY_EXPORT(convex_column_blocks);
HWY_EXPORT(blend_convex_tile);
HWY_EXPORT(blend_convex_tile_backward);

constexpr std::size_t kPlanes = 4;
}  // namespace

void blend_convexes(ConvexFrame& frame, std::span<float> color, std::span<float> alpha, const Threads& threads) {
  frame.tile_images.ensure(frame.tiles() * kPlanes * kTilePixels);
  frame.tile_stop.ensure(frame.tiles());
  frame.entry_rows.ensure(frame.entries.size() * HWY_DYNAMIC_DISPATCH(convex_column_blocks)());
  threads.for_range(frame.tiles(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t tile = begin; tile < end; ++tile) {
      float* const image = frame.tile_images.data() + tile * kPlanes * kTilePixels;
      HWY_DYNAMIC_DISPATCH(blend_convex_tile)(frame, tile, image);
      const TileArea area(frame, tile);
      store_planes(area, image, 3, color);
      store_planes(area, image + 3 * kTilePixels, 1, alpha);
    }
  });
}

void blend_convexes_backward(ConvexFrame& frame, std::span<const float> color, std::span<const float> alpha,
                             const Threads& threads) {
  frame.entry_moments.ensure(frame.entries.size());
  threads.for_range(frame.tiles(), 1, [&](std::size_t begin, std::size_t end) {
    alignas(64) float upstream[kPlanes * kTilePixels];
    for (std::size_t tile = begin; tile < end; ++tile) {
      const TileArea area(frame, tile);
      load_planes(area, color, 3, upstream);
      load_planes(area, alpha, 1, upstream + 3 * kTilePixels);
      HWY_DYNAMIC_DISPATCH(blend_convex_tile_backward)
      (frame, tile, frame.tile_images.data() + tile * kPlanes * kTilePixels, upstream);
    }
  });
}

}  // namespace splatboost
#endif  // HWY_ONCE
