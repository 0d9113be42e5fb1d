// SPDX-License-Identifier: Apache-2.0
#include "splatboost/multi_view_scores.h"

#include <algorithm>
#include <numeric>

#include "density/cuda_ops.h"
#include "splatboost/errors.h"

namespace splatboost {

std::vector<std::size_t> draw_views(std::size_t n, int k, const RandomStream& random) {
  SPLATBOOST_CHECK(k > 0, "the number of scored views must be above 0");
  std::vector<std::size_t> views(n);
  std::iota(views.begin(), views.end(), std::size_t{0});
  const std::size_t drawn = std::min(n, static_cast<std::size_t>(k));
  for (std::size_t i = 0; i < drawn; ++i) std::swap(views[i], views[i + random.below(i, n - i)]);
  views.resize(drawn);
  return views;
}

MultiViewScorer::MultiViewScorer(Device device) : device_(device), photometric_(device) {
  if (!device.is_cuda()) return;
  CudaStream& stream = device.stream();
  cuda_.emplace(OnCuda{DeviceArray<float>(stream), DeviceArray<std::uint8_t>(stream), DeviceArray<std::int32_t>(stream),
                       DeviceArray<std::int64_t>(stream), DeviceArray<double>(stream)});
}

double MultiViewScorer::loss_of(const ScoredView& view, const MultiViewOptions& options) {
  return options.losses ? photometric_.evaluate(view.color, view.truth, options.lambda_dssim, {}).total : 0;
}

void MultiViewScorer::note(const ErrorCounts& found, double loss) {
  sums_.weighted_pixels += loss * static_cast<double>(found.flagged);
  valid_pixels_ += static_cast<double>(found.valid);
  covered_pixels_ += static_cast<double>(found.covered);
}

void MultiViewScorer::score_view(RasterizerHook& rasterizer, const ScoredView& view, const MultiViewOptions& options) {
  const std::size_t pixels = view.truth.color.size() / 3;
  error_.resize(pixels);
  flagged_.resize(pixels);
  const ErrorCounts found = flag_errors(view.color, view.truth, options.tau, error_, flagged_, device_);
  const double loss = loss_of(view, options);
  counts_.assign(sums_.counts.size(), 0);
  rasterizer.count_flagged(flagged_, counts_);
  sums_.add_view(counts_, loss);
  note(found, loss);
}

void MultiViewScorer::score_view_on_cuda(RasterizerHook& rasterizer, const ScoredView& view,
                                         const MultiViewOptions& options) {
  CudaStream& stream = device_.stream();
  const std::size_t pixels = view.truth.color.size() / 3;
  cuda_->error.ensure(pixels);
  cuda_->flagged.ensure(pixels);
  const ErrorCounts found =
      flag_errors(view.color, view.truth, options.tau, cuda_->error.span(), cuda_->flagged.span(), device_);
  const double loss = loss_of(view, options);
  cuda_->view_counts.ensure(sums_.counts.size());
  cuda_->view_counts.fill_zero();
  rasterizer.count_flagged(cuda_->flagged.span(), cuda_->view_counts.span());
  cuda::add_view(cuda_->view_counts.span(), loss, cuda_->counts.span(), cuda_->weighted_counts.span(), stream);
  ++sums_.views;
  note(found, loss);
}

const ScoreSums& MultiViewScorer::score(RasterizerHook& rasterizer, const MultiViewOptions& options,
                                        const RandomStream& random) {
  sums_.reset(rasterizer.primitives(), options.losses);
  valid_pixels_ = covered_pixels_ = 0;
  if (cuda_) {
    cuda_->counts.ensure(sums_.counts.size());
    cuda_->counts.fill_zero();
    cuda_->weighted_counts.ensure(sums_.weighted_counts.size());
    cuda_->weighted_counts.fill_zero();
  }
  double pixels = 0;
  for (const std::size_t index : draw_views(rasterizer.scorable_views(), options.views, random)) {
    const ScoredView view = rasterizer.render_for_score(index);
    pixels += static_cast<double>(view.truth.width) * static_cast<double>(view.truth.height);
    if (cuda_) {
      score_view_on_cuda(rasterizer, view, options);
    } else {
      score_view(rasterizer, view, options);
    }
  }
  if (cuda_) {
    cuda_->counts.download(sums_.counts);
    cuda_->weighted_counts.download(sums_.weighted_counts);
  }
  mean_pixels_ = sums_.views > 0 ? pixels / sums_.views : 0;
  covered_share_ = valid_pixels_ > 0 ? covered_pixels_ / valid_pixels_ : 1;
  return sums_;
}

}  // namespace splatboost
