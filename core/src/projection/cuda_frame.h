// SPDX-License-Identifier: Apache-2.0
/// @file Data that the stages of the CUDA rasterizer share for one view: project → tiles → blend → backward. The
/// counterpart of frame.h.
#pragma once

#include <cstdint>

#include "projection/projection_camera.h"
#include "splatboost/device_array.h"
#include "splatboost/rasterizer.h"

namespace splatboost::cuda {

/// The data of a splat that blending reads, in three 16-byte loads. The quadratic form is that of log2 α, as in
/// BlendRecord.
struct alignas(16) SplatRecord {
  float mean_x, mean_y;
  float log2_opacity;
  float depth;
  float quadratic_xx, quadratic_xy, quadratic_yy;
  std::uint32_t gaussian;
  float red, green, blue;
  float unused;
};

/// The ellipse of a splat's compact box: Ellipse of tile_math.h.
struct alignas(16) SplatEllipse {
  float mean_x, mean_y;
  float conic_xx, conic_xy, conic_yy;
  float t;
  float half_width, half_height;
};

/// Tiles of a splat's bounding box, half-open.
struct alignas(8) TileBox {
  std::uint16_t x_begin, x_end, y_begin, y_end;
};

/// Half-open range of a tile's entries.
struct alignas(8) TileEntries {
  std::uint32_t begin, end;
};

/// Numbers that are known only on the device when the work of a frame is queued.
struct FrameTotals {
  std::uint32_t visible;                     ///< Gaussians that are listed in a tile
  std::uint32_t entries;                     ///< (tile, Gaussian) pairs, at most 2^32 - 1 (SaturatedSum); too few if
                                             ///< visible exceeded visible_room
  std::uint32_t most_visible, most_entries;  ///< maxima over all frames so far
};

/// Sums over the pixels of a splat, as in EntryMoments, from which its gradients are computed. Columns of a row of
/// kMomentColumns.
enum Moment : int {
  kMomentS,
  kMomentSX,
  kMomentSY,
  kMomentSXX,
  kMomentSXY,
  kMomentSYY,
  kMomentRed,
  kMomentGreen,
  kMomentBlue,
  kMomentAbsX,
  kMomentAbsY,
  kMomentInverseDepth,
  kMoments
};
inline constexpr int kMomentColumns = 16;

inline constexpr std::uint32_t kTilePixels = kTileSize * kTileSize;

/// Most items of an array that CUB sorts.
inline constexpr std::size_t kMaxRoom = (std::size_t{1} << 31) - 1;

/// Workspace of one view.
struct CudaFrame {
  explicit CudaFrame(CudaStream& of_arrays) : stream(of_arrays) {}

  CudaStream& stream;
  Camera camera;
  RasterOptions options;
  ProjectionCamera projection{};
  std::size_t gaussians = 0;
  bool color = true;           ///< whether colour is rendered in this view
  int features = 0;            ///< extra channels per Gaussian that are rendered
  bool inverse_depth = false;  ///< whether inverse depth is rendered
  int tiles_x = 0, tiles_y = 0;

  DeviceArray<SplatRecord> records{stream};        ///< [N]
  DeviceArray<SplatEllipse> ellipses{stream};      ///< [N] set if the box is an ellipse
  DeviceArray<TileBox> boxes{stream};              ///< [N]
  DeviceArray<std::uint32_t> tile_counts{stream};  ///< [N] number of tiles that list the Gaussian
  DeviceArray<std::uint8_t> visible{stream};       ///< [N]
  DeviceArray<std::int32_t> radii{stream};         ///< [N]
  DeviceArray<float> channels{stream};             ///< [N, extra_channels()] features, then inverse depth

  DeviceArray<std::uint32_t> places{stream};  ///< [N+1] number of visible Gaussians before each

  // Arrays are larger than the numbers of visible Gaussians and entries, which are known only on the device. Unused
  // elements have keys that sort last.
  std::size_t visible_room = 0, entry_room = 0;
  DeviceArray<std::uint32_t> listed{stream};      ///< [visible_room] Gaussians that are visible, by index
  DeviceArray<std::uint32_t> depth_keys{stream};  ///< [visible_room] bits of their depths
  DeviceArray<std::uint32_t> depth_keys_swap{stream};
  DeviceArray<std::uint32_t> order{stream};          ///< [visible_room] visible Gaussians, near to far, ties by index
  DeviceArray<std::uint32_t> entry_offsets{stream};  ///< [visible_room + 1] first entry of each, in that order
  DeviceArray<std::uint32_t> tile_keys{stream};  ///< [entry_room] tile of each entry, grouped by Gaussian, near to far
  DeviceArray<std::uint32_t> tile_keys_swap{stream};
  DeviceArray<std::uint32_t> entries_swap{stream};  ///< [entry_room] their Gaussians
  DeviceArray<std::uint32_t> entries{stream};       ///< [entry_room] Gaussians, grouped by tile, near to far
  DeviceArray<TileEntries> tile_entries{stream};    ///< [T]
  DeviceArray<FrameTotals> totals{stream};          ///< [1]
  DeviceArray<std::uint8_t> scratch{stream};        ///< scratch memory of CUB

  DeviceArray<float> pixels{stream};   ///< [4 + extra_channels(), H, W] blended colour (0 if not rendered), alpha, ...
  DeviceArray<float> moments{stream};  ///< [N, kMomentColumns]
  DeviceArray<float> feature_gradients{stream};  ///< [N, features]

  int extra_channels() const { return features + (inverse_depth ? 1 : 0); }
  std::size_t tiles() const { return static_cast<std::size_t>(tiles_x) * static_cast<std::size_t>(tiles_y); }
  std::size_t image_pixels() const {
    return static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  }
};

/// Fills records, ellipses, boxes, tile_counts, visible, radii and channels, and sets places to 1 for each visible
/// Gaussian. (project_cuda.cu)
void project(CudaFrame& frame, const Gaussians& gaussians, CudaStream& stream);
/// Computes the gradients of the Gaussians from moments. (project_cuda.cu)
void project_backward(const CudaFrame& frame, const Gaussians& gaussians, const GaussianGradients& gradients,
                      CudaStream& stream);
/// Sums places. (tiles_cuda.cu)
void count_visible(CudaFrame& frame, CudaStream& stream);
/// Sorts the first visible_room visible Gaussians by depth, fills entry_offsets and sets totals.visible.
/// (tiles_cuda.cu)
void sort_by_depth(CudaFrame& frame, CudaStream& stream);
/// Fills entries, at most entry_room of them, and tile_entries, and sets totals.entries. (tiles_cuda.cu)
void build_tile_lists(CudaFrame& frame, CudaStream& stream);
/// Blends all tiles. (blend_cuda.cu)
void blend(CudaFrame& frame, const RasterImages& images, CudaStream& stream);
/// Fills moments and feature_gradients. (blend_backward_cuda.cu)
void blend_backward(CudaFrame& frame, const RasterImageGradients& gradients, bool absolute, CudaStream& stream);
/// Adds the numbers of flagged pixels to counts. (count_cuda.cu)
void count_flagged_pixels(const CudaFrame& frame, std::span<const std::uint8_t> flagged, std::span<std::int32_t> counts,
                          CudaStream& stream);
/// Adds to counts the pixels where a splat was blended while the transmittance was above `min_transmittance`.
/// (count_cuda.cu)
void count_observed_pixels(const CudaFrame& frame, float min_transmittance, std::span<std::int32_t> counts,
                           CudaStream& stream);
/// Adds each splat's blending weights in units of kWeightUnit. (count_cuda.cu)
void add_blending_weights(const CudaFrame& frame, std::span<std::int32_t> weights, CudaStream& stream);

}  // namespace splatboost::cuda
