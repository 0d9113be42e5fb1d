// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "geometry/patch_views.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "geometry/patches_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "device/lanes-inl.h"
#include "geometry/patch_math.h"

#ifndef SPLATBOOST_PATCH_JOB_
#define SPLATBOOST_PATCH_JOB_
namespace splatboost {

struct PatchJob {
  const PatchViews* views;
  int row;
  std::span<const std::int32_t> columns;
  const float *planes, *greys_first, *greys_second;
  float *losses, *counts;
  PatchGradient* gradients;
};

}  // namespace splatboost
#endif  // SPLATBOOST_PATCH_JOB_

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

/// Reads pixels of an image, one per lane.
struct Texels {
  const float* image;
  int width;
  HWY_INLINE Float operator()(Float column, Float row) const {
    const hn::RebindToSigned<Lanes> d;
    const auto at = hn::Add(hn::Mul(hn::ConvertTo(d, row.v), hn::Set(d, width)), hn::ConvertTo(d, column.v));
    return Float(hn::GatherIndex(Lanes(), image, at));
  }
};

void match_row(const PatchJob& job) {
  const PatchViews& views = *job.views;
  const Texels first{job.greys_first, views.width_first}, second{job.greys_second, views.width_second};
  const std::size_t width = static_cast<std::size_t>(views.width);
  const std::size_t pixels = width * static_cast<std::size_t>(views.height);
  const Float row(place_in_photo(job.row, views.per_y));
  for (std::size_t begin = 0; begin < job.columns.size(); begin += lanes()) {
    const std::size_t count = std::min(lanes(), job.columns.size() - begin);
    alignas(64) float column[kTileSize], plane[4][kTileSize];
    for (std::size_t lane = 0; lane < lanes(); ++lane) {
      const std::int32_t x = job.columns[begin + std::min(lane, count - 1)];
      column[lane] = place_in_photo(x, views.per_x);
      const std::size_t p = static_cast<std::size_t>(job.row) * width + static_cast<std::size_t>(x);
      for (std::size_t c = 0; c < 4; ++c) plane[c][lane] = job.planes[c * pixels + p];
    }
    const Float normal[3] = {load(plane[0]), load(plane[1]), load(plane[2])};
    const PatchMatch<Float> match = match_patch(views, load(column), row, normal, load(plane[3]), first, second);
    alignas(64) float out[6][kTileSize];
    store(match.loss, out[0]);
    store(match.counts, out[1]);
    for (std::size_t c = 0; c < 3; ++c) store(match.normal[c], out[2 + c]);
    store(match.distance, out[5]);
    std::copy_n(out[0], count, job.losses + begin);
    std::copy_n(out[1], count, job.counts + begin);
    for (std::size_t lane = 0; lane < count; ++lane) {
      job.gradients[begin + lane] = {{out[2][lane], out[3][lane], out[4][lane]}, out[5][lane]};
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost {
HWY_EXPORT(match_row);

void match_patches(const PatchViews& views, int row, std::span<const std::int32_t> columns,
                   std::span<const float> planes, std::span<const float> greys_first,
                   std::span<const float> greys_second, std::span<float> losses, std::span<float> counts,
                   std::span<PatchGradient> gradients) {
  HWY_DYNAMIC_DISPATCH(match_row)
  ({&views, row, columns, planes.data(), greys_first.data(), greys_second.data(), losses.data(), counts.data(),
    gradients.data()});
}

}  // namespace splatboost
#endif  // HWY_ONCE
