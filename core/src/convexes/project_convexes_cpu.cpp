// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstring>
#include <vector>

#include "convexes/convex_frame.h"
#include "convexes/convex_viewpoint.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "convexes/project_convexes_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "convexes/convex_blocks-inl.h"
#include "projection/primitive_blocks-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

constexpr std::size_t kMaxPointColumns = 3 * static_cast<std::size_t>(kMaxConvexPoints);
constexpr std::size_t kRecordFloats = sizeof(ConvexRecord) / sizeof(float);
constexpr std::size_t kMomentFloats = sizeof(ConvexMoments) / sizeof(float);
constexpr std::size_t kShapeFields = 2;  ///< floats of a record that hold the bytes of the hull's vertices

/// Offset of a field in a record or in moments, in floats.
#define SPLATBOOST_COLUMN(type, field) (offsetof(type, field) / sizeof(float))

Float number_at(std::span<const float> rows, std::size_t i, std::size_t count) {
  Float v[1];
  load_rows(rows.data() + i, count, v);
  return v[0];
}

using Whole = hn::Vec<hn::RebindToSigned<Lanes>>;

Whole whole_of(Float a) { return hn::ConvertTo(hn::RebindToSigned<Lanes>(), a.v); }
Float bits_of(Whole a) { return Float(hn::BitCast(Lanes(), a)); }

/// Packs the indices of four vertices of a hull into bytes, as in a record.
Float packed(const Float* vertices) {
  const hn::RebindToSigned<Lanes> d;
  Whole bytes = whole_of(vertices[3]);
  for (int k = 2; k >= 0; --k) bytes = hn::Or(hn::ShiftLeft<8>(bytes), whole_of(vertices[k]));
  return Float(hn::BitCast(Lanes(), hn::BitCast(d, bytes)));
}

Ray ray_to(const ConvexBlock& p, const ConvexViewpoint& view) {
  Vec3<Float> centre = p.mean;
  if (view.released_view_direction) centre.x = centre.y = centre.z;
  return ray_to(centre, view.camera);
}

void points_at(const Convexes& convexes, std::size_t i, std::size_t count, float* columns) {
  const std::size_t width = 3 * static_cast<std::size_t>(convexes.points_per_convex);
  rows_to_columns(convexes.points.data() + width * i, width, count, width, columns);
}

/// Lists a block in no tile.
void list_nothing(ConvexFrame& frame, std::size_t i, std::size_t count, std::vector<std::uint32_t>& listed) {
  const Float zero(0.0f);
  list_tiles(frame, i, count, zero, zero, listed, [&](Float) HWY_ATTR { return TileRange<Float>{zero, zero}; });
  std::fill_n(frame.visible.data() + i, count, std::uint8_t{0});
}

void project_block(ConvexFrame& frame, const Convexes& convexes, const ConvexViewpoint& view, std::size_t i,
                   std::size_t count, std::vector<std::uint32_t>& listed) {
  const Float zero(0.0f);
  const int points = convexes.points_per_convex;
  const Float opacity = number_at(convexes.opacities, i, count);
  const Bool drawn = opacity > Float(kMinAlpha);
  if (!any_of(drawn)) return list_nothing(frame, i, count, listed);
  alignas(64) float columns[kMaxPointColumns * kMaxLanes];
  points_at(convexes, i, count, columns);
  ConvexBlock p;
  place_points(view.camera, columns, points, view.near_plane, p);
  const Float scale = p.depth * number_at(convexes.smoothness, i, count) * Float(view.pixel_area);
  const Float steepness = p.depth * number_at(convexes.sharpness, i, count);
  const Float most(1e30f);
  p.valid = p.valid & drawn & (scale > zero) & (scale < most) & (steepness > zero) & (steepness < most);
  if (!any_of(p.valid)) return list_nothing(frame, i, count, listed);
  HullBlock hulls;
  find_hulls(p, points, hulls);
  p.valid = p.valid & (hulls.edges > Float(2.5f));
  EdgeBlock edges;
  find_edges(hulls, points, edges);
  const Float farthest = farthest_of(opacity, steepness);

  if (view.square) {
    const Float radius = released_radii(hulls, edges, points, Float(2.1f) / (scale * steepness));
    const TileRange<Float> x = square_tiles(p.centre_x, radius, view.tiles_x);
    const TileRange<Float> y = square_tiles(p.centre_y, radius, view.tiles_y);
    const Bool some = p.valid & (radius > zero) & (x.begin < x.end) & (y.begin < y.end);
    if (!any_of(some)) return list_nothing(frame, i, count, listed);
    list_tiles(frame, i, count, select(some, y.begin, zero), select(some, y.end - y.begin, zero), listed,
               [&](Float) HWY_ATTR { return x; });
  } else {
    // If farthest <= 0, α reaches 1/255 only inside the hull; then β must not scale the bound.
    const Float reach = select(farthest > zero, Float(view.beta) * farthest, farthest);
    const FootprintBlock footprints(p, edges, points, scale, reach, view.width, view.height);
    const TileRange<Float> y =
        tiles_meeting(p.centre_y + footprints.low_y, p.centre_y + footprints.high_y, view.tiles_y);
    const Bool some = footprints.some & p.valid & (y.begin < y.end);
    if (!any_of(some)) return list_nothing(frame, i, count, listed);
    list_tiles(frame, i, count, select(some, y.begin, zero), select(some, y.end - y.begin, zero), listed,
               [&](Float row) HWY_ATTR {
                 const Float top = row * Float(kTileSize) + Float(0.5f) - p.centre_y;
                 Float low, high;
                 footprints.width_within(top, top + Float(kTileSize - 1), low, high);
                 return tiles_meeting(p.centre_x + low, p.centre_x + high, view.tiles_x);
               });
  }
  bool any = false;
  for (std::size_t lane = 0; lane < count; ++lane) {
    const bool seen = frame.listings[i + lane].tiles > 0;
    frame.visible[i + lane] = seen ? 1 : 0;
    any |= seen;
  }
  if (!any) return;

  const Vec3<Float> color = color_at(convexes, i, count, ray_to(p, view).direction);
  Float fields[kRecordFloats];
  std::fill_n(fields, kRecordFloats, zero);
  const auto put = [&](std::size_t column, Float value) HWY_ATTR { fields[column] = value; };
  put(SPLATBOOST_COLUMN(ConvexRecord, centre_x), p.centre_x);
  put(SPLATBOOST_COLUMN(ConvexRecord, centre_y), p.centre_y);
  put(SPLATBOOST_COLUMN(ConvexRecord, steepness), steepness);
  put(SPLATBOOST_COLUMN(ConvexRecord, opacity), opacity);
  put(SPLATBOOST_COLUMN(ConvexRecord, farthest), Float(kLog2E) * (farthest + Float(1e-4f) * abs_of(farthest)));
  put(SPLATBOOST_COLUMN(ConvexRecord, red), color.x);
  put(SPLATBOOST_COLUMN(ConvexRecord, green), color.y);
  put(SPLATBOOST_COLUMN(ConvexRecord, blue), color.z);
  put(SPLATBOOST_COLUMN(ConvexRecord, depth), p.depth);
  put(SPLATBOOST_COLUMN(ConvexRecord, edges), bits_of(whole_of(hulls.edges)));
  const Float unit = Float(kLog2E) * scale;
  Float vertices[kMaxConvexPoints];
  for (int k = 0; k < kMaxConvexPoints; ++k) {
    const auto at = static_cast<std::size_t>(k);
    const Bool is_edge = Float(k < points ? static_cast<float>(k) : 1e9f) < hulls.edges;
    const int edge = k < points ? k : 0;
    vertices[k] = select(is_edge, hulls.index[edge], zero);
    put(SPLATBOOST_COLUMN(ConvexRecord, edge_x) + at, select(is_edge, unit * edges.x[edge], zero));
    put(SPLATBOOST_COLUMN(ConvexRecord, edge_y) + at, select(is_edge, unit * edges.y[edge], zero));
    put(SPLATBOOST_COLUMN(ConvexRecord, edge_offset) + at,
        select(is_edge, unit * edges.offset[edge], Float(kNeverNear)));
  }
  put(SPLATBOOST_COLUMN(ConvexRecord, hull), packed(vertices));
  put(SPLATBOOST_COLUMN(ConvexRecord, hull) + 1, packed(vertices + 4));
  alignas(64) float record_columns[kRecordFloats * kMaxLanes];
  for (std::size_t f = 0; f < kRecordFloats; ++f) store(fields[f], record_columns + f * lanes());
  columns_to_rows(record_columns, kRecordFloats, count, false, &frame.records[i].centre_x, kRecordFloats);
  for (std::size_t lane = 0; lane < count; ++lane) frame.depths[i + lane] = frame.records[i + lane].depth;
}

void project_convex_range(ConvexFrame& frame, const Convexes& convexes, const ConvexViewpoint& view, std::size_t begin,
                          std::size_t end) {
  std::vector<std::uint32_t>& listed = frame.listed_tiles[begin / kProjectGrain];
  listed.clear();
  for (std::size_t i = begin; i < end; i += lanes()) {
    project_block(frame, convexes, view, i, std::min(lanes(), end - i), listed);
  }
}

/// Sums a block's moments over the entries of its convexes, in the order of slots.
/// @param columns [kMomentFloats, lanes]
/// @param moved [lanes] 1 for a convex with a sum that is not 0, else 0
/// @return whether there is one
bool gather(const ConvexFrame& frame, std::size_t i, std::size_t count, float* columns, float* moved) {
  constexpr std::size_t kVectors = kMomentFloats / lanes();
  const Lanes d;
  alignas(64) float rows[kMaxLanes * kMomentFloats];
  bool any = false;
  for (std::size_t lane = 0; lane < count; ++lane) {
    Float sum[kVectors];
    for (Float& s : sum) s = Float(0.0f);
    if (frame.visible[i + lane] != 0) {
      const std::size_t slot = frame.first_slot(i + lane);
      for (std::uint32_t k = 0; k < frame.listings[i + lane].tiles; ++k) {
        const auto* entry = reinterpret_cast<const float*>(&frame.entry_moments[slot + k]);
        for (std::size_t v = 0; v < kVectors; ++v) sum[v] += Float(hn::Load(d, entry + v * lanes()));
      }
    }
    // Most convexes that lie behind others have sums of 0.
    Mask zeros = hn::Eq(sum[0].v, hn::Zero(d));
    for (std::size_t v = 1; v < kVectors; ++v) zeros = hn::And(zeros, hn::Eq(sum[v].v, hn::Zero(d)));
    const bool moves = !hn::AllTrue(d, zeros);
    moved[lane] = moves ? 1.0f : 0.0f;
    any |= moves;
    for (std::size_t v = 0; v < kVectors; ++v) hn::Store(sum[v].v, d, rows + lane * kMomentFloats + v * lanes());
  }
  if (any) rows_to_columns(rows, kMomentFloats, count, kMomentFloats, columns);
  return any;
}

void clear_block(const ConvexGradients& g, const Convexes& convexes, std::size_t i, std::size_t count) {
  clear_rows(g.view_sharpness, 1, i, count);
  clear_rows(g.view_sharpness_abs, 1, i, count);
  clear_rows(g.screen_points, 3, i, count);
  if (g.mode == GradientMode::accumulate) return;
  clear_rows(g.points, 3 * static_cast<std::size_t>(convexes.points_per_convex), i, count);
  clear_rows(g.smoothness, 1, i, count);
  clear_rows(g.sharpness, 1, i, count);
  clear_rows(g.opacities, 1, i, count);
  clear_rows(g.sh_dc, 3, i, count);
  clear_rows(g.sh_rest, 3 * static_cast<std::size_t>(convexes.sh_rest_rows), i, count);
  clear_rows(g.colors, 3, i, count);
}

/// Positions on screen of the hulls' vertices, as stored in the records by the forward pass: rounding might give
/// another hull now.
/// @param record_columns [kShapeFields + 1, lanes] a record's fields from `edges` on
void drawn_hulls(const ConvexBlock& p, int points, const float* record_columns, HullBlock& hulls) {
  const hn::RebindToSigned<Lanes> d;
  const auto bits_at = [&](std::size_t column)
                           HWY_ATTR { return hn::BitCast(d, load(record_columns + column * lanes()).v); };
  hulls.edges = Float(hn::ConvertTo(Lanes(), bits_at(0)));
  Whole bytes = bits_at(1);
  for (int k = 0; k < points; ++k) {
    if (k == 4) bytes = bits_at(2);
    const Float vertex(hn::ConvertTo(Lanes(), hn::And(bytes, hn::Set(d, 0xFF))));
    bytes = hn::ShiftRight<8>(bytes);
    const Bool is_edge = Float(static_cast<float>(k)) < hulls.edges;
    hulls.index[k] = k == 0 ? vertex : select(is_edge, vertex, hulls.index[0]);
    Float x = p.x[0], y = p.y[0];
    for (int j = 1; j < points; ++j) {
      const Bool same = are_equal(hulls.index[k], Float(static_cast<float>(j)));
      x = select(same, p.x[j], x);
      y = select(same, p.y[j], y);
    }
    hulls.x[k] = x;
    hulls.y[k] = y;
  }
}

void backward_block(const ConvexFrame& frame, const Convexes& convexes, const ConvexViewpoint& view,
                    const ConvexGradients& out, std::size_t i, std::size_t count) {
  alignas(64) float moments[kMomentFloats * kMaxLanes];
  alignas(64) float moved[kMaxLanes] = {};
  if (!gather(frame, i, count, moments, moved)) return clear_block(out, convexes, i, count);
  const Float zero(0.0f), one(1.0f);
  const BlockWriter writer{i, count, out.mode == GradientMode::accumulate, load(moved) > zero};
  const auto moment = [&](std::size_t column) HWY_ATTR { return load(moments + column * lanes()); };
  const int points = convexes.points_per_convex;
  const auto width = 3 * static_cast<std::size_t>(points);

  alignas(64) float columns[kMaxPointColumns * kMaxLanes];
  points_at(convexes, i, count, columns);
  ConvexBlock p;
  place_points(view.camera, columns, points, view.near_plane, p);
  constexpr std::size_t kShape = SPLATBOOST_COLUMN(ConvexRecord, edges);
  alignas(64) float shape_columns[(kShapeFields + 1) * kMaxLanes];
  rows_to_columns(&frame.records[i].centre_x + kShape, kRecordFloats, count, kShapeFields + 1, shape_columns);
  HullBlock hulls;
  drawn_hulls(p, points, shape_columns, hulls);
  EdgeBlock edges;
  find_edges(hulls, points, edges);

  const Float smoothness = number_at(convexes.smoothness, i, count),
              sharpness = number_at(convexes.sharpness, i, count), opacity = number_at(convexes.opacities, i, count);
  const Float area(view.pixel_area);
  const Float scale = p.depth * smoothness * area, steepness = p.depth * sharpness;
  const Float of_steepness = Float(kLn2) * moment(SPLATBOOST_COLUMN(ConvexMoments, steepness));
  Float of_scale = zero;
  Float v_x[kMaxConvexPoints], v_y[kMaxConvexPoints];  // gradients of the hull's vertices
  std::fill_n(v_x, kMaxConvexPoints, zero);
  std::fill_n(v_y, kMaxConvexPoints, zero);
  for (int k = 0; k < points; ++k) {
    const Bool is_edge = Float(static_cast<float>(k)) < hulls.edges;
    const auto sum = [&](std::size_t m) HWY_ATTR {
      const std::size_t column = SPLATBOOST_COLUMN(ConvexMoments, edge) + 3 * static_cast<std::size_t>(k) + m;
      return select(is_edge, steepness * moment(column), zero);
    };
    const Float e = sum(0), e_x = sum(1), e_y = sum(2);
    of_scale += edges.x[k] * e_x + edges.y[k] * e_y + edges.offset[k] * e;
    // L = n·(q − a), n = (b_y − a_y, a_x − b_x)
    const Float n_x = scale * (e_x - e * hulls.x[k]), n_y = scale * (e_y - e * hulls.y[k]);
    const Float along = scale * e;
    v_x[k] += n_y - along * edges.x[k];
    v_y[k] = v_y[k] - (n_x + along * edges.y[k]);
    // The last edge ends where the first begins.
    const Bool goes_on = Float(static_cast<float>(k + 1)) < hulls.edges;
    v_x[0] = v_x[0] - select(goes_on, zero, n_y);
    v_y[0] += select(goes_on, zero, n_x);
    if (k + 1 == points) continue;
    v_x[k + 1] = v_x[k + 1] - select(goes_on, n_y, zero);
    v_y[k + 1] += select(goes_on, n_x, zero);
  }
  const Float g_depth =
      (sharpness * of_steepness + smoothness * area * of_scale) * Float(1.0f / static_cast<float>(points));

  Vec3<Float> of_centre{zero, zero, zero};  // gradient through the view direction, for each point
  const Vec3<Float> g_color{moment(SPLATBOOST_COLUMN(ConvexMoments, red)),
                            moment(SPLATBOOST_COLUMN(ConvexMoments, green)),
                            moment(SPLATBOOST_COLUMN(ConvexMoments, blue))};
  if (!convexes.colors.empty()) {
    writer.write(out.colors, {g_color.x, g_color.y, g_color.z});
  } else {
    // No gradient where the colour was clamped at zero.
    alignas(64) float drawn_colors[3 * kMaxLanes];
    rows_to_columns(&frame.records[i].red, kRecordFloats, count, 3, drawn_colors);
    const auto unclamped = [&](std::size_t c, Float g)
                               HWY_ATTR { return select(load(drawn_colors + c * lanes()) > zero, g, zero); };
    const Vec3<Float> g{unclamped(0, g_color.x), unclamped(1, g_color.y), unclamped(2, g_color.z)};
    of_centre = Float(1.0f / static_cast<float>(points)) * sh_backward(convexes, out, writer, ray_to(p, view), g);
  }

  const Vec3<Float> axis_x = widen<Float>(view.camera.axis_x), axis_y = widen<Float>(view.camera.axis_y),
                    axis_z = widen<Float>(view.camera.axis_z);
  Float screen[3] = {zero, zero, zero};
  for (int j = 0; j < points; ++j) {
    Float g_x = zero, g_y = zero;  // gradient on screen
    for (int k = 0; k < points; ++k) {
      const Bool same = are_equal(hulls.index[k], Float(static_cast<float>(j)));
      g_x += select(same, v_x[k], zero);
      g_y += select(same, v_y[k], zero);
    }
    screen[0] += g_x;
    screen[1] += g_y;
    screen[2] += abs_of(g_x) + abs_of(g_y);
    const Float inverse = one / p.view[j].z;
    const Float c_x = Float(view.camera.fx) * g_x * inverse, c_y = Float(view.camera.fy) * g_y * inverse;
    const Float c_z = g_depth - (c_x * p.view[j].x + c_y * p.view[j].y) * inverse;
    const Vec3<Float> g = c_x * axis_x + c_y * axis_y + c_z * axis_z + of_centre;
    float* const to = columns + 3 * static_cast<std::size_t>(j) * lanes();
    store(select(writer.visible, g.x, zero), to);
    store(select(writer.visible, g.y, zero), to + lanes());
    store(select(writer.visible, g.z, zero), to + 2 * lanes());
  }
  if (!out.points.empty()) {
    columns_to_rows(columns, width, count, writer.adds, out.points.data() + width * i, width);
  }
  const Float g_sharpness = p.depth * of_steepness;
  writer.write(out.smoothness, {p.depth * area * of_scale});
  writer.write(out.sharpness, {g_sharpness});
  writer.write(out.opacities, {moment(SPLATBOOST_COLUMN(ConvexMoments, s)) / opacity});  // dα/do = α/o
  writer.write(out.view_sharpness, {g_sharpness}, false);
  writer.write(out.view_sharpness_abs,
               {p.depth * Float(kLn2) * moment(SPLATBOOST_COLUMN(ConvexMoments, steepness_abs))}, false);
  writer.write(out.screen_points, {screen[0], screen[1], screen[2]}, false);
}

void convex_backward_range(const ConvexFrame& frame, const Convexes& convexes, const ConvexViewpoint& view,
                           const ConvexGradients& gradients, std::size_t begin, std::size_t end) {
  for (std::size_t i = begin; i < end; i += lanes()) {
    backward_block(frame, convexes, view, gradients, i, std::min(lanes(), end - i));
  }
}

#undef SPLATBOOST_COLUMN

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost {
namespace {
HWY_EXPORT(project_convex_range);
HWY_EXPORT(convex_backward_range);
}  // namespace

void project_convexes(ConvexFrame& frame, const Convexes& convexes, const Threads& threads) {
  const std::size_t n = convexes.count;
  frame.records.ensure(n);
  frame.depths.ensure(n);
  frame.visible.ensure(n);
  frame.listings.ensure(n);
  if (frame.listed_tiles.size() < frame.pieces()) frame.listed_tiles.resize(frame.pieces());
  const ConvexViewpoint view = make_viewpoint(frame.camera, frame.options);
  threads.for_range(n, kProjectGrain, [&](std::size_t begin, std::size_t end) {
    HWY_DYNAMIC_DISPATCH(project_convex_range)(frame, convexes, view, begin, end);
  });
}

void project_convexes_backward(const ConvexFrame& frame, const Convexes& convexes, const ConvexGradients& gradients,
                               const Threads& threads) {
  const ConvexViewpoint view = make_viewpoint(frame.camera, frame.options);
  threads.for_range(frame.primitives, kProjectGrain, [&](std::size_t begin, std::size_t end) {
    HWY_DYNAMIC_DISPATCH(convex_backward_range)(frame, convexes, view, gradients, begin, end);
  });
}

}  // namespace splatboost
#endif  // HWY_ONCE
