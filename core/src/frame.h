// SPDX-License-Identifier: Apache-2.0
/// @file What the stages of the rasterizer hand to one another for one view: project → tiles → blend → backward.
#pragma once

#include <cstdint>

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "buffer.h"
#include "project_math.h"
#include "splatboost/rasterizer.h"
#include "tile_math.h"

namespace splatboost {

/// A projected Gaussian, at the Gaussian's own index; one cache line, because the tile lists visit them by depth.
struct alignas(64) Splat {
  glm::vec2 mean;         ///< px
  Symmetric2 covariance;  ///< px², low-pass included
  Symmetric2 conic;
  float depth;
  float opacity;  ///< compensated
  float reach;    ///< Mahalanobis² where alpha = 1/255
  glm::vec3 color;
  std::uint16_t tile_x0, tile_x1, tile_y0, tile_y1;  ///< bounding tiles; empty: not drawn
};

inline constexpr float kHalfLog2E = 0.7213475204444817f;  ///< ½·log2(e): from ½·Mahalanobis² to powers of two

/// What blending reads of a splat, one cache line, stored near to far. The quadratic form is that of log2 α:
/// log2 α(d) = log2_opacity + quadratic_xx·dx² + quadratic_xy·dx·dy + quadratic_yy·dy².
struct alignas(64) BlendRecord {
  float mean_x, mean_y;
  float quadratic_xx, quadratic_xy, quadratic_yy;
  float log2_opacity;
  float ridge;  ///< dx / dy of the line along which a row's α is greatest
  float red, green, blue;
  std::uint32_t gaussian;
};

/// Sums over the pixels of one (tile, splat) entry, from which the gradients of its splat follow; one cache line.
/// Written where the splat's sum will read them in a row: a write that misses the cache costs little, a read that does
/// stalls. s = α·dL/dα.
struct alignas(64) EntryMoments {
  float s, s_x, s_y;            ///< Σs, Σs·dx, Σs·dy
  float s_xx, s_xy, s_yy;       ///< Σs·dx², Σs·dx·dy, Σs·dy²
  float red, green, blue;       ///< Σ weight · gradient of the image
  float abs_x, abs_y;           ///< Σ|s·∂ log2 α/∂x|, Σ|s·∂ log2 α/∂y|
  float inverse_depth;
  float unused[4];
};

/// Workspace of one view.
struct Frame {
  Camera camera;
  RasterOptions options;
  ProjectionCamera projection;
  std::size_t gaussians = 0;
  int features = 0;            ///< extra channels of the Gaussians that are drawn in this view
  bool inverse_depth = false;  ///< whether inverse depth is drawn
  int tiles_x = 0, tiles_y = 0;

  Buffer<Splat> splats;          ///< [N]
  Buffer<std::uint8_t> visible;  ///< [N]
  Buffer<std::int32_t> radii;    ///< [N]

  // Small arrays of what sorting and binning ask of every splat: these stay in the cache, splats do not.
  Buffer<std::uint16_t> tile_rows;   ///< [N] height of a splat's bounding tiles; 0: not drawn
  Buffer<std::uint32_t> depth_bits;  ///< [N] depth as an integer of the same order, where drawn

  Buffer<std::uint32_t> order;  ///< [V] Gaussians that may be visible, near to far
  Buffer<std::uint32_t> sort_keys, sort_keys_swap, order_swap;
  Buffer<std::uint32_t> row_begin;  ///< [V+1] first row span of a splat in row_spans
  Buffer<TileRange> row_spans;
  Buffer<std::uint16_t> first_row;    ///< [V] tile row of a splat's first span
  Buffer<std::uint32_t> tile_begin;   ///< [T+1] first entry of a tile
  Buffer<std::uint32_t> tile_cursor;  ///< [chunks, T]
  Buffer<std::uint32_t> entries;      ///< [E] positions in `order`, tile by tile, near to far
  Buffer<std::uint32_t> splat_begin;  ///< [N+1] first slot of a Gaussian
  Buffer<std::uint32_t> slots;        ///< [E] an entry's place when entries are ordered Gaussian by Gaussian

  Buffer<BlendRecord> records;      ///< [V]
  Buffer<float> channels;           ///< [V, extra_channels()] features, then inverse depth
  Buffer<std::uint16_t> entry_rows;  ///< [E, blocks of columns] rows of the tile that an entry reaches
  Buffer<std::uint32_t> tile_stop;  ///< [T] entries of the tile that were looked at before all pixels were full
  Buffer<float> tile_images;        ///< [T, 4 + extra_channels(), 256] blended colour, alpha, extra channels

  Buffer<EntryMoments> entry_moments;     ///< [E] by slot
  Buffer<float> entry_channel_gradients;  ///< [E, features] by slot

  int extra_channels() const { return features + (inverse_depth ? 1 : 0); }
  std::size_t tiles() const { return static_cast<std::size_t>(tiles_x) * static_cast<std::size_t>(tiles_y); }
};

/// Fills splats and radii. (project_cpu.cpp)
void project(Frame& frame, const Gaussians& gaussians, Threads& threads);
/// Sums entry gradients per splat and takes them back to the Gaussians. (project_cpu.cpp)
void project_backward(const Frame& frame, const Gaussians& gaussians, const GaussianGradients& gradients,
                      Threads& threads);
/// Sorts by depth and fills the tile lists, visible and records. (tiles_cpu.cpp)
void build_tile_lists(Frame& frame, const Gaussians& gaussians, Threads& threads);
/// Blends all tiles. (blend_cpu.cpp)
void blend(Frame& frame, const RasterImages& images, Threads& threads);
/// Fills the entry gradients. (blend_cpu.cpp)
void blend_backward(Frame& frame, const RasterImageGradients& gradients, bool absolute, Threads& threads);
/// Adds flagged pixels to counts. (count_cpu.cpp)
void count_flagged_pixels(const Frame& frame, std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts,
                          Threads& threads);

}  // namespace splatboost
