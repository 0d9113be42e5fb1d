// SPDX-License-Identifier: Apache-2.0
#include "program/bench/cuda_work.h"

#include <bit>

namespace splatboost::program {
namespace {

// Parameters per Gaussian.
constexpr double kGeometry = 3 + 3 + 4 + 1;  // mean, scale, rotation, opacity
constexpr double kRest = 45, kDc = 3;        // spherical harmonics
constexpr double kParameters = kGeometry + kDc + kRest;

// Operations per Gaussian of functions that several stages call.
constexpr double kShape = 82;        // covariance of scale and rotation
constexpr double kProject = 103;     // project_gaussian()
constexpr double kTileRowEnds = 49;  // ellipse_tiles_in_row(), of at least one row
constexpr double kRay = 13;
constexpr double kBasis = 49;  // sh_basis() of degree 3

// Bytes of the data that stages pass on (cuda_frame.h).
constexpr double kRecord = 48, kEllipse = 32, kBox = 8, kTileCount = 4, kVisible = 1, kPlace = 4, kRadius = 4;
constexpr double kMomentRow = 64;
constexpr double kEntry = 4;
constexpr double kOwnPixel = 16, kImagePixel = 12;  // colour and alpha as the backward pass reads them; colour

// Operations per pixel and splat.
constexpr double kStep = 14;          // offsets 2, exponent 8, power 1, clamp 1, transmittance 2
constexpr double kBlend = kStep + 7;  // weight 1, three colours 6
// Weight 1, the splat's part of the gradient 6, gain 1, what lies behind 1, slope of alpha 3, first and second moments
// 5, colours 3, absolute slopes 10, eleven sums 11.
constexpr double kBlendBackward = kStep + 41;

Effort activate(double splats) {
  // Three exponentials with a clamp, one sigmoid: exponential, clamp, sum, division.
  return {(3 * 2 + 4) * splats, 4 * 2 * 4 * splats};
}

Effort project(double visible) {
  const double color = kRay + kBasis + 99;
  const double box = 13 + 34 + kTileRowEnds;  // radius, ellipse and its box
  return {(kShape + kProject + 3 + box + color + 4) * visible,
          (4 * kParameters + kRecord + kEllipse + kBox + kTileCount + kVisible + kPlace + kRadius) * visible};
}

Effort tile_lists(double splats, double visible, double entries, std::size_t tiles) {
  constexpr double kPair = 8;                          // key and value
  constexpr double kDepthSort = 4 * 2 * kPair + 4;     // four passes, keys read once more for the histograms
  constexpr double kListed = 4 + 4 + kPair;            // place and depth to key and value
  constexpr double kOffsets = 4 + kTileCount + 4 + 8;  // order, tiles, and their sums
  const int whole_passes = (static_cast<int>(std::bit_width(tiles)) + 7) / 8;
  const double passes = whole_passes;
  return {kTileRowEnds * visible, (kVisible + 2 * kPlace) * splats +
                                      (kListed + kDepthSort + kOffsets + 4 + 4 + kBox + kEllipse) * visible +
                                      (kPair + passes * 2 * kPair + 4 + 4) * entries};
}

Effort loss(double values) {
  constexpr double kTaps = 11;
  // Blurs across and down of two means, squares and products; SSIM and its derivatives; L1; sums.
  const double similarity = 1 + 4 + 2 * 4 * 2 * kTaps + 28 + 4;
  const double gradient = 3 * 2 * 2 * kTaps + 10;
  // Render, truth and three derivatives, written and read; the gradient.
  return {(similarity + gradient) * values, (4 + 1 + 12 + 12 + 4 + 1 + 4) * values};
}

Effort project_backward(double visible) {
  const double harmonics = kRay + kBasis + 123 + 128;  // coefficients, direction
  const double operations = kShape + kProject + 8 + 4 + 149 + 142 + harmonics + 3 + 3 + 2;
  return {(operations + kParameters) * visible,  // gradients are added to those of earlier views
          (kVisible + kRecord + kMomentRow + 4 * (kGeometry + kRest) + 2 * 4 * kParameters + 4 * 4) * visible};
}

Effort optimizer(double splats) {
  constexpr double kAdam = 13;                                              // first moment 3, second 4, step 6
  return {kAdam * kParameters * splats, 4 * 2 * 4 * kParameters * splats};  // value, gradient, moments: read, written
}

}  // namespace

std::map<std::string, Effort> cuda_efforts(const BlendWork& work, std::uint64_t warps, const Camera& camera,
                                           std::size_t splats) {
  const auto n = static_cast<double>(splats), visible = static_cast<double>(work.visible);
  const auto entries = static_cast<double>(work.entries), pixels = static_cast<double>(work.pixels);
  const auto lanes = static_cast<double>(kInstructionPixels.pixels()) * static_cast<double>(work.cells);
  const double tables = (kEntry + kRecord) * entries, sums = kMomentRow * n;
  const auto tiles = static_cast<std::size_t>(camera.tiles_x()) * static_cast<std::size_t>(camera.tiles_y());
  constexpr double kMomentsInUse = 4 * 11;  // bytes
  std::map<std::string, Effort> efforts{
      {"activate", activate(n)},
      {"project", project(visible)},
      {"tile_lists", tile_lists(n, visible, entries, tiles)},
      {"blend", {kBlend * lanes, tables + (kOwnPixel + kImagePixel) * pixels}},
      {"loss", loss(3 * pixels)},
      {"blend_backward",
       {kBlendBackward * lanes,
        tables + sums + kMomentsInUse * static_cast<double>(warps) + (kOwnPixel + kImagePixel) * pixels}},
      {"project_backward", project_backward(visible)},
      {"optimizer", optimizer(n)}};
  Effort whole;
  for (const auto& [stage, effort] : efforts) {
    whole.operations += effort.operations;
    whole.bytes += effort.bytes;
  }
  efforts["iteration"] = whole;
  return efforts;
}

}  // namespace splatboost::program
