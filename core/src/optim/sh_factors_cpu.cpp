// SPDX-License-Identifier: Apache-2.0
#include "splatboost/sh_factors.h"

#include <algorithm>

#include "optim/adam_math.h"
#include "splatboost/errors.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "optim/sh_factors_cpu.cpp"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "projection/primitive_blocks-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatboost {
namespace HWY_NAMESPACE {

/// Adds a view's gradients of a block of Gaussians to columns [rest columns, lanes].
void add_block(const ShFactors& view, std::size_t i, std::size_t count, float* sums) {
  const int used = sh_coefficients(view.degree) - 1;
  const float* const factors = view.rows.data() + kShFactors * i;
  bool any = false;
  for (std::size_t lane = 0; lane < count; ++lane) {
    const float* const color = factors + kShFactors * lane + 3;
    any |= color[0] != 0 || color[1] != 0 || color[2] != 0;
  }
  if (used == 0 || !any) return;
  alignas(64) float columns[kShFactors * kMaxLanes], products[kRestColumns * kMaxLanes];
  rows_to_columns(factors, kShFactors, count, kShFactors, columns);
  const auto factor = [&](std::size_t k) HWY_ATTR { return load(columns + k * lanes()); };
  Float basis[kMaxShCoefficients];
  sh_basis(view.degree, Vec3<Float>{factor(0), factor(1), factor(2)}, basis);
  // Products and sums are separate loops, so that each is rounded, as where a backward pass adds to gradients in
  // memory. Exact resume needs equal bits, also of the basis and of Adam, which are compiled here a second time; a
  // test compares them.
  sh_products(basis, used, {factor(3), factor(4), factor(5)}, products);
  for (std::size_t at = 0; at < 3 * static_cast<std::size_t>(used) * lanes(); at += lanes()) {
    store(load(sums + at) + load(products + at), sums + at);
  }
}

/// Sums the gradients of the views for a block of Gaussians. @param rows [count,stride]
void sum_block(std::span<const ShFactors> views, std::size_t i, std::size_t count, float* rows, std::size_t stride) {
  alignas(64) float sums[kRestColumns * kMaxLanes];
  std::fill_n(sums, stride * lanes(), 0.0f);
  for (const ShFactors& view : views) add_block(view, i, count, sums);
  columns_to_rows(sums, stride, count, false, rows, stride);
}

void sum_range(std::span<const ShFactors> views, std::size_t stride, std::size_t begin, std::size_t end,
               float* gradients) {
  for (std::size_t i = begin; i < end; i += lanes()) {
    sum_block(views, i, std::min(lanes(), end - i), gradients + stride * i, stride);
  }
}

void step_range(std::span<const ShFactors> views, std::size_t stride, std::size_t begin, std::size_t end,
                float* HWY_RESTRICT values, float* HWY_RESTRICT first, float* HWY_RESTRICT second,
                const AdamFactors& f) {
  alignas(64) float gradients[kRestColumns * kMaxLanes];
  for (std::size_t i = begin; i < end; i += lanes()) {
    const std::size_t count = std::min(lanes(), end - i);
    sum_block(views, i, count, gradients, stride);
    for (std::size_t k = 0, at = stride * i; k < stride * count; ++k, ++at) {
      adam_one(f, gradients[k], values[at], first[at], second[at]);
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace splatboost
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace splatboost {
namespace {
HWY_EXPORT(sum_range);
HWY_EXPORT(step_range);
constexpr std::size_t kGrain = 1024;  // Gaussians

/// Returns the number of coefficients' values per Gaussian.
std::size_t check(std::span<const ShFactors> views, int sh_rest_rows, std::size_t values) {
  SPLATBOOST_CHECK(sh_rest_rows > 0 && sh_rest_rows < kMaxShCoefficients, "sh_rest_rows must be 1 to 15");
  const std::size_t stride = 3 * static_cast<std::size_t>(sh_rest_rows);
  SPLATBOOST_CHECK(values % stride == 0, "the coefficients must be [N,sh_rest_rows,3]");
  for (const ShFactors& view : views) {
    SPLATBOOST_CHECK(view.rows.size() == kShFactors * (values / stride), "the factors of a view must be [N,6]");
    SPLATBOOST_CHECK(view.degree >= 0 && sh_coefficients(view.degree) - 1 <= sh_rest_rows,
                     "the degree of a view must be that of the coefficients or lower");
  }
  return stride;
}
}  // namespace

void sum_sh_gradients(std::span<const ShFactors> views, int sh_rest_rows, std::span<float> gradients,
                      const Threads& threads) {
  const std::size_t stride = check(views, sh_rest_rows, gradients.size());
  threads.for_range(gradients.size() / stride, kGrain, [&](std::size_t begin, std::size_t end) {
    HWY_DYNAMIC_DISPATCH(sum_range)(views, stride, begin, end, gradients.data());
  });
}

void adam_step_sh(std::span<float> values, int sh_rest_rows, std::span<const ShFactors> views,
                  std::span<float> first_moments, std::span<float> second_moments, std::int64_t step,
                  const AdamOptions& options, const Threads& threads) {
  const std::size_t stride = check(views, sh_rest_rows, values.size());
  SPLATBOOST_CHECK(first_moments.size() == values.size() && second_moments.size() == values.size(),
                   "values and moments must have the same size");
  SPLATBOOST_CHECK(step >= 1, "steps count from 1");
  const AdamFactors factors = adam_factors(options, step);
  threads.for_range(values.size() / stride, kGrain, [&](std::size_t begin, std::size_t end) {
    HWY_DYNAMIC_DISPATCH(step_range)
    (views, stride, begin, end, values.data(), first_moments.data(), second_moments.data(), factors);
  });
}

}  // namespace splatboost
#endif  // HWY_ONCE
