// SPDX-License-Identifier: Apache-2.0
/// @file Data passed between the stages of the convex rasterizer for one view: project → tiles → blend →
/// backward. The counterpart of projection/frame.h.
#pragma once

#include <cstdint>
#include <span>

#include "convexes/convex_math.h"
#include "device/buffer.h"
#include "projection/projection_camera.h"
#include "projection/tile_lists.h"
#include "splatboost/convex_rasterizer.h"

namespace splatboost {

/// Inputs of blending for one convex, stored at the convex's index. With φ₂ = log2 Σ_k 2^(t_k), where t_k =
/// edge_x[k]·dx + edge_y[k]·dy + edge_offset[k] and dx, dy are relative to the centre: I = 1 / (1 + 2^(steepness·φ₂)).
struct alignas(16) ConvexRecord {
  float centre_x, centre_y;  ///< px
  float steepness;           ///< z·σ
  float opacity;
  float farthest;  ///< greatest max_k t_k at which α may reach 1/255
  float red, green, blue;
  float depth;
  std::uint32_t edges;                  ///< of the hull; the arrays are padded with edges that never contribute
  std::uint8_t hull[kMaxConvexPoints];  ///< vertices of the hull, as in ProjectedConvex
  float unused[4];
  float edge_x[kMaxConvexPoints], edge_y[kMaxConvexPoints], edge_offset[kMaxConvexPoints];
};

/// Sums over the pixels of one (tile, convex) entry, from which the gradients of its convex follow. s = α·dL/dα, and
/// u = −s·(1 − I) is the gradient of z·σ·φ.
struct alignas(64) ConvexMoments {
  float red, green, blue;  ///< Σ weight · gradient of the image
  float s;                 ///< Σs
  float steepness;         ///< Σu·φ₂
  float steepness_abs;     ///< Σ|u·φ₂|
  float unused[2];
  float edge[kMaxConvexPoints][3];  ///< Σu·w_k, Σu·w_k·dx, Σu·w_k·dy, w_k = 2^(t_k − φ₂)
};

/// Workspace of one view.
struct ConvexFrame : TileLists {
  ConvexOptions options;

  Buffer<ConvexRecord> records;         ///< [N]
  Buffer<std::uint8_t> visible;         ///< [N]
  Buffer<std::uint16_t> entry_rows;     ///< [E, blocks of columns] rows of the tile that an entry may reach
  Buffer<std::uint32_t> tile_stop;      ///< [T] entries of the tile that were processed before all pixels were closed
  Buffer<float> tile_images;            ///< [T, 4, 256] blended colour, alpha
  Buffer<ConvexMoments> entry_moments;  ///< [E] by slot
};

/// Fills records, depths, visible, listings and their tiles. (project_convexes_cpu.cpp)
void project_convexes(ConvexFrame& frame, const Convexes& convexes, const Threads& threads);
/// Sums entry gradients per convex and propagates them to the convexes' parameters. (project_convexes_cpu.cpp)
void project_convexes_backward(const ConvexFrame& frame, const Convexes& convexes, const ConvexGradients& gradients,
                               const Threads& threads);
/// Blends all tiles. (blend_convexes_cpu.cpp)
void blend_convexes(ConvexFrame& frame, std::span<float> color, std::span<float> alpha, const Threads& threads);
/// Fills the entry moments. (blend_convexes_cpu.cpp)
void blend_convexes_backward(ConvexFrame& frame, std::span<const float> color, std::span<const float> alpha,
                             const Threads& threads);
/// Adds flagged pixels to counts. (count_convexes_cpu.cpp)
void count_flagged_convexes(const ConvexFrame& frame, std::span<const std::uint8_t> flagged,
                            std::span<std::int32_t> counts, const Threads& threads);
/// Adds blending weights. (count_convexes_cpu.cpp)
void add_convex_weights(const ConvexFrame& frame, std::span<std::int32_t> weights, const Threads& threads);

}  // namespace splatboost
