// SPDX-License-Identifier: Apache-2.0
/// @file Code shared by the projections of Gaussians and of convexes for a block of primitives, one per lane: colours
/// from spherical harmonics and their gradient, writing rows of gradients, and listing the tiles of a block. The last
/// block of a range may be shorter than the number of lanes.
///
/// Compiled once per instruction set (Highway's per-target include), hence no ordinary include guard.

#if defined(SPLATBOOST_PRIMITIVE_BLOCKS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_PRIMITIVE_BLOCKS_INL_H_
#undef SPLATBOOST_PRIMITIVE_BLOCKS_INL_H_
#else
#define SPLATBOOST_PRIMITIVE_BLOCKS_INL_H_
#endif

#include <algorithm>
#include <cstring>
#include <span>
#include <utility>
#include <vector>

#include <hwy/highway.h>

#include "device/buffer.h"
#include "device/lanes-inl.h"
#include "projection/project_math.h"
#include "projection/sh_math.h"
#include "projection/tile_lists.h"
#include "projection/tile_math.h"
#include "splatboost/sh_factors.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

inline constexpr std::size_t kMaxLanes = kTileSize;
inline constexpr std::size_t kRestColumns = 3 * (kMaxShCoefficients - 1);

inline Vec3<Float> vec3_at(std::span<const float> rows, std::size_t i, std::size_t count) {
  Float v[3];
  load_rows(rows.data() + 3 * i, count, v);
  return {v[0], v[1], v[2]};
}

/// View directions from the camera to the primitives of a block.
struct Ray {
  Vec3<Float> direction;
  Float inverse_length;
};

inline Ray ray_to(Vec3<Float> mean, const ProjectionCamera& camera) {
  const Vec3<Float> ray = mean - widen<Float>(camera.centre);
  const Float inverse_length = Float(1.0f) / sqrt_of(dot(ray, ray));
  return {inverse_length * ray, inverse_length};
}

/// Loads the active coefficients of degree 1 and above. @param columns [3 · used, lanes]
template <class Primitives>
void sh_rest_at(const Primitives& primitives, std::size_t i, std::size_t count, float* columns) {
  const std::size_t stride = 3 * static_cast<std::size_t>(primitives.sh_rest_rows);
  const auto used = static_cast<std::size_t>(sh_coefficients(primitives.sh_degree) - 1);
  rows_to_columns(primitives.sh_rest.data() + stride * i, stride, count, 3 * used, columns);
}

/// Colours of a block as seen along `direction`.
/// @param primitives Gaussians or Convexes
template <class Primitives>
Vec3<Float> color_at(const Primitives& primitives, std::size_t i, std::size_t count, Vec3<Float> direction) {
  if (!primitives.colors.empty()) return vec3_at(primitives.colors, i, count);
  Float basis[kMaxShCoefficients];
  sh_basis(primitives.sh_degree, direction, basis);
  Float color[3];
  load_rows(primitives.sh_dc.data() + 3 * i, count, color);
  for (Float& c : color) c = Float(0.5f) + basis[0] * c;
  alignas(64) float rest[kRestColumns * kMaxLanes];
  sh_rest_at(primitives, i, count, rest);
  const int used = sh_coefficients(primitives.sh_degree) - 1;
  const float* coefficient = rest;
  for (int k = 1; k <= used; ++k) {
    for (Float& c : color) {
      c += basis[k] * load(coefficient);
      coefficient += lanes();
    }
  }
  return {max_of(color[0], Float(0.0f)), max_of(color[1], Float(0.0f)), max_of(color[2], Float(0.0f))};
}

inline void store_whole(Float a, std::int32_t* to) {
  const hn::RebindToSigned<Lanes> d;
  hn::StoreU(hn::ConvertTo(d, a.v), d, to);
}

/// [rows, lanes] first tile column and end of each primitive in each of its rows of tiles.
struct RowTilesScratch {
  Buffer<std::int32_t> begin, end;
};

inline RowTilesScratch& row_tiles_of_thread() {
  thread_local RowTilesScratch scratch;
  return scratch;
}

/// Appends the tiles of a block's primitives to `listed` and fills lists.listings.
/// @param first_row,row_count [lanes] the rows of tiles that each primitive may meet
/// @param tiles_in_row returns the range of tile columns in a row
template <class RowTiles>
void list_tiles(TileLists& lists, std::size_t i, std::size_t count, Float first_row, Float row_count,
                std::vector<std::uint32_t>& listed, RowTiles&& tiles_in_row) {
  alignas(64) std::int32_t first[kMaxLanes], rows[kMaxLanes], totals[kMaxLanes] = {};
  store_whole(first_row, first);
  store_whole(row_count, rows);
  const std::int32_t most = *std::max_element(rows, rows + count);
  RowTilesScratch& scratch = row_tiles_of_thread();
  scratch.begin.ensure(static_cast<std::size_t>(most) * lanes());
  scratch.end.ensure(static_cast<std::size_t>(most) * lanes());
  Float total(0.0f);
  for (std::int32_t row = 0; row < most; ++row) {
    const Float at(static_cast<float>(row));
    TileRange<Float> tiles = tiles_in_row(first_row + at);
    tiles.begin = select(at < row_count, tiles.begin, Float(0.0f));
    tiles.end = select(at < row_count, max_of(tiles.end, tiles.begin), Float(0.0f));
    total += tiles.end - tiles.begin;
    store_whole(tiles.begin, scratch.begin.data() + static_cast<std::size_t>(row) * lanes());
    store_whole(tiles.end, scratch.end.data() + static_cast<std::size_t>(row) * lanes());
  }
  store_whole(total, totals);

  // Tiles are written eight at a time, whatever their number: rows are short, so this mostly avoids branch
  // mispredictions at the end of a row. The next row overwrites the excess.
  constexpr std::size_t kAtATime = 8;
  std::size_t at = listed.size() < kAtATime ? 0 : listed.size() - kAtATime;
  std::size_t end = at;
  for (std::size_t lane = 0; lane < count; ++lane) end += static_cast<std::size_t>(totals[lane]);
  check_entries(end);
  listed.resize(end + kAtATime);
  for (std::size_t lane = 0; lane < count; ++lane) {
    TileListing& listing = lists.listings[i + lane];
    listing.first = static_cast<std::uint32_t>(at);
    listing.tiles = static_cast<std::uint32_t>(totals[lane]);
    auto row_start = static_cast<std::uint32_t>(first[lane] * lists.tiles_x);
    const std::int32_t* begin = scratch.begin.data() + lane;
    const std::int32_t* row_end = scratch.end.data() + lane;
    for (std::int32_t row = 0; row < rows[lane]; ++row) {
      const std::uint32_t tile = row_start + static_cast<std::uint32_t>(*begin);
      const auto n = static_cast<std::size_t>(*row_end - *begin);
      for (std::size_t done = 0; done < n; done += kAtATime) {
        std::uint32_t* to = listed.data() + at + done;
        for (std::uint32_t k = 0; k < kAtATime; ++k) to[k] = tile + static_cast<std::uint32_t>(done) + k;
      }
      at += n;
      row_start += static_cast<std::uint32_t>(lists.tiles_x);
      begin += lanes();
      row_end += lanes();
    }
  }
}

/// Writes the gradients of a block, or adds them to the output; they are zero for primitives that are not visible.
struct BlockWriter {
  std::size_t i, count;
  bool adds;
  Bool visible;

  template <std::size_t W>
  HWY_INLINE void write(std::span<float> rows, Float (&&columns)[W], bool add) const {
    if (rows.empty()) return;
    for (Float& c : columns) c = select(visible, c, Float(0.0f));
    store_rows(columns, count, add, rows.data() + W * i);
  }
  template <std::size_t W>
  HWY_INLINE void write(std::span<float> rows, Float (&&columns)[W]) const {
    write(rows, std::move(columns), adds);
  }
};

/// Gradients of the `used` coefficients of degree 1 and above: products of the basis and the gradient of the colour.
/// @param columns [3 · used, lanes]
HWY_INLINE void sh_products(const Float* basis, int used, Vec3<Float> g_color, float* columns) {
  const Float g[3] = {g_color.x, g_color.y, g_color.z};
  for (int k = 1; k <= used; ++k) {
    for (const Float& c : g) {
      store(basis[k] * c, columns);
      columns += lanes();
    }
  }
}

/// Gradient through spherical harmonics: writes that of the coefficients, returns that of the mean.
/// @param primitives Gaussians or Convexes; `out` is the matching gradients struct
template <class Primitives, class Gradients>
HWY_INLINE Vec3<Float> sh_backward(const Primitives& primitives, const Gradients& out, const BlockWriter& writer,
                                   const Ray& ray, Vec3<Float> g_color) {
  const int degree = primitives.sh_degree, used = sh_coefficients(degree) - 1;
  const Float zero(0.0f);
  const auto seen = [&](const Vec3<Float>& v) HWY_ATTR {  // also zero where a value that is not drawn is not finite
    return Vec3<Float>{select(writer.visible, v.x, zero), select(writer.visible, v.y, zero),
                       select(writer.visible, v.z, zero)};
  };
  const Vec3<Float> direction = seen(ray.direction), g = seen(g_color);
  Float basis[kMaxShCoefficients];
  sh_basis(degree, direction, basis);
  writer.write(out.sh_dc, {basis[0] * g_color.x, basis[0] * g_color.y, basis[0] * g_color.z});

  alignas(64) float columns[kRestColumns * kMaxLanes];
  const std::size_t width = 3 * static_cast<std::size_t>(primitives.sh_rest_rows);
  if (!out.sh_rest.empty()) {
    sh_products(basis, used, g, columns);
    float* const rows = out.sh_rest.data() + width * writer.i;
    const std::size_t written = 3 * static_cast<std::size_t>(used);
    if (used > 0) columns_to_rows(columns, written, writer.count, writer.adds, rows, width);
    for (std::size_t lane = 0; !writer.adds && written < width && lane < writer.count; ++lane) {
      std::memset(rows + width * lane + written, 0, (width - written) * sizeof(float));
    }
  }
  if constexpr (requires { out.sh_factors; }) {
    if (!out.sh_factors.empty()) {
      const Float factors[kShFactors] = {direction.x, direction.y, direction.z, g.x, g.y, g.z};
      for (std::size_t k = 0; k < kShFactors; ++k) store(factors[k], columns + k * lanes());
      columns_to_rows(columns, kShFactors, writer.count, false, out.sh_factors.data() + kShFactors * writer.i,
                      kShFactors);
    }
  }
  if (degree == 0) return {zero, zero, zero};
  sh_rest_at(primitives, writer.i, writer.count, columns);
  Float weights[kMaxShCoefficients];
  weights[0] = zero;
  const float* coefficient = columns;
  for (int k = 1; k <= used; ++k) {
    weights[k] = zero;
    for (const Float& c : {g.x, g.y, g.z}) {
      weights[k] += load(coefficient) * c;
      coefficient += lanes();
    }
  }
  return through_normalise(ray.direction, ray.inverse_length, sh_basis_gradient(degree, ray.direction, weights));
}

inline void clear_rows(std::span<float> rows, std::size_t width, std::size_t i, std::size_t count) {
  if (!rows.empty()) std::memset(rows.data() + width * i, 0, width * count * sizeof(float));
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
