// SPDX-License-Identifier: Apache-2.0
#include "mip_splatting/mip_splatting_adapter.h"

namespace splatboost {
namespace {

VanillaBoost on_sums(VanillaBoost boost) {
  boost.gradient_abs_threshold *= kAbsoluteSumOverLength;
  return boost;
}

}  // namespace

MipSplattingAdapter::MipSplattingAdapter(const VanillaBoost& boost, Device device)
    : VanillaAdapter(on_sums(boost), device) {}

}  // namespace splatboost
