// SPDX-License-Identifier: Apache-2.0
/// @file Data passed between the stages of the CUDA convex rasterizer for one view. The counterpart of
/// convex_frame.h.
#pragma once

#include <cstdint>

#include "convexes/convex_project.h"
#include "splatboost/device_array.h"

namespace splatboost::cuda {

/// Half-open range of a tile's entries.
struct alignas(8) ConvexTileEntries {
  std::uint32_t begin, end;
};

/// Number of sums over the pixels per convex: the floats of ConvexMoments.
inline constexpr int kConvexMomentColumns = 32;
static_assert(sizeof(ConvexMoments) == kConvexMomentColumns * sizeof(float));

/// Workspace of one view.
struct CudaConvexFrame {
  explicit CudaConvexFrame(CudaStream& of_arrays) : stream(of_arrays) {}

  CudaStream& stream;
  Camera camera;
  ConvexOptions options;
  ConvexViewpoint view{};
  std::size_t convexes = 0;

  DeviceArray<ConvexRecord> records{stream};                         ///< [N]
  DeviceArray<ConvexTiles> tiles_of{stream};                         ///< [N]
  DeviceArray<std::uint8_t> visible{stream};                         ///< [N]
  DeviceArray<std::uint32_t> entry_offsets{stream};                  ///< [N+1] first entry of each
  DeviceArray<std::uint64_t> keys{stream}, keys_swap{stream};        ///< [E] tile (high half), depth bits (low half)
  DeviceArray<std::uint32_t> entries{stream}, entries_swap{stream};  ///< [E] convexes, tile by tile, near to far
  DeviceArray<ConvexTileEntries> tile_entries{stream};               ///< [T]
  DeviceArray<float> pixels{stream};                                 ///< [4,H,W] blended colour, alpha
  DeviceArray<float> moments{stream};                                ///< [N, kConvexMomentColumns]
  DeviceArray<std::uint8_t> scratch{stream};                         ///< for CUB

  std::size_t tiles() const { return static_cast<std::size_t>(view.tiles_x) * static_cast<std::size_t>(view.tiles_y); }
  std::size_t image_pixels() const {
    return static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  }
};

/// Fills records, tiles_of, visible, and entry_offsets with the number of entries per convex, before the scan.
/// (project_convexes_cuda.cu)
void project_convexes(CudaConvexFrame& frame, const Convexes& convexes, CudaStream& stream);
/// Propagates moments to the convexes' parameters. (project_convexes_cuda.cu)
void project_convexes_backward(const CudaConvexFrame& frame, const Convexes& convexes, const ConvexGradients& gradients,
                               CudaStream& stream);
/// Fills entries and tile_entries. Waits for the device, to read the number of entries. @return E
/// (convex_tiles_cuda.cu)
std::size_t build_convex_lists(CudaConvexFrame& frame, CudaStream& stream);
/// Blends all tiles. (blend_convexes_cuda.cu)
void blend_convexes(CudaConvexFrame& frame, std::span<float> color, std::span<float> alpha, CudaStream& stream);
/// Fills moments. (blend_convexes_cuda.cu)
void blend_convexes_backward(CudaConvexFrame& frame, std::span<const float> color, std::span<const float> alpha,
                             CudaStream& stream);
/// Adds flagged pixels to counts. (blend_convexes_cuda.cu)
void count_flagged_convexes(const CudaConvexFrame& frame, std::span<const std::uint8_t> flagged,
                            std::span<std::int32_t> counts, CudaStream& stream);
/// Adds blending weights. (blend_convexes_cuda.cu)
void add_convex_weights(const CudaConvexFrame& frame, std::span<std::int32_t> weights, CudaStream& stream);

}  // namespace splatboost::cuda
