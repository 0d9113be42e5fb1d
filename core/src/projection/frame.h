// SPDX-License-Identifier: Apache-2.0
/// @file Data that the stages of the CPU rasterizer share for one view: project → tiles → blend → backward.
#pragma once

#include <cstdint>

#include "device/buffer.h"
#include "projection/projection_camera.h"
#include "projection/tile_lists.h"
#include "splatboost/rasterizer.h"

namespace splatboost {

/// The data of a splat that blending reads: one cache line, at the index of the Gaussian. The splats of a tile are
/// neighbours in space, so if Gaussians are stored in spatial order their records are neighbours too. The quadratic
/// form is that of log2 α: log2 α(d) = log2_opacity + quadratic_xx·dx² + quadratic_xy·dx·dy + quadratic_yy·dy².
struct alignas(64) BlendRecord {
  float mean_x, mean_y;
  float quadratic_xx, quadratic_xy, quadratic_yy;
  float log2_opacity;
  float ridge;             ///< dx / dy of the line through the maximum of α in each pixel row
  float red, green, blue;  ///< zero if colour is not rendered
  float depth;
  float unused[5];
};

/// Sums over the pixels of one (tile, splat) entry, from which the gradients of its splat are computed; one cache line.
/// Stored by slot, so that the entries of a splat are read sequentially: a write that misses the cache costs little,
/// but a read that misses stalls. s = α·dL/dα.
struct alignas(64) EntryMoments {
  float s, s_x, s_y;       ///< Σs, Σs·dx, Σs·dy
  float s_xx, s_xy, s_yy;  ///< Σs·dx², Σs·dx·dy, Σs·dy²
  float red, green, blue;  ///< Σ weight · gradient of the image
  float abs_x, abs_y;      ///< Σ|s·∂ log2 α/∂x|, Σ|s·∂ log2 α/∂y|
  float inverse_depth;
  float unused[4];
};

/// Workspace of one view.
struct Frame : TileLists {
  RasterOptions options;
  ProjectionCamera projection;
  bool color = true;           ///< whether colour is rendered in this view
  int features = 0;            ///< extra channels per Gaussian that are rendered
  bool inverse_depth = false;  ///< whether inverse depth is rendered

  Buffer<BlendRecord> records;   ///< [N]
  Buffer<std::uint8_t> visible;  ///< [N]
  Buffer<std::int32_t> radii;    ///< [N]
  Buffer<float> channels;        ///< [N, extra_channels()] features, then inverse depth

  Buffer<std::uint16_t> entry_rows;  ///< [E, blocks of columns] bit mask of the tile's rows that an entry reaches
  Buffer<std::uint32_t> tile_stop;   ///< [T] entries of the tile processed until all pixels were saturated
  /// [T, 4 + extra_channels(), 256] blended colour (if rendered), alpha, extra channels
  Buffer<float> tile_images;

  Buffer<EntryMoments> entry_moments;     ///< [E] by slot
  Buffer<float> entry_channel_gradients;  ///< [E, features] by slot

  int extra_channels() const { return features + (inverse_depth ? 1 : 0); }
};

/// Fills records, depths, visible, radii, channels, listings and their tiles. (project_cpu.cpp)
void project(Frame& frame, const Gaussians& gaussians, const Threads& threads);
/// Sums the entry moments per splat and computes the gradients of the Gaussians. (project_cpu.cpp)
void project_backward(const Frame& frame, const Gaussians& gaussians, const GaussianGradients& gradients,
                      const Threads& threads);
/// Blends all tiles. (blend_cpu.cpp)
void blend(Frame& frame, const RasterImages& images, const Threads& threads);
/// Fills entry_moments and entry_channel_gradients. (blend_cpu.cpp)
void blend_backward(Frame& frame, const RasterImageGradients& gradients, bool absolute, const Threads& threads);
/// Adds the numbers of flagged pixels to counts. (count_cpu.cpp)
void count_flagged_pixels(const Frame& frame, std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts,
                          const Threads& threads);
/// Adds to counts the pixels where a splat was blended while the transmittance was above `min_transmittance`.
/// (count_cpu.cpp)
void count_observed_pixels(const Frame& frame, float min_transmittance, std::span<std::int32_t> counts,
                           const Threads& threads);
/// Adds each splat's blending weights in units of kWeightUnit. (count_cpu.cpp)
void add_blending_weights(const Frame& frame, std::span<std::int32_t> weights, const Threads& threads);

}  // namespace splatboost
