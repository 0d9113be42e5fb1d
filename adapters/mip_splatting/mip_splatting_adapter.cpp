// SPDX-License-Identifier: Apache-2.0
#include "mip_splatting/mip_splatting_adapter.h"

#include "registry/boost_settings.h"

namespace splatboost {
namespace {

VanillaBoost on_sums(VanillaBoost boost) {
  boost.gradient_abs_threshold *= kAbsoluteSumOverLength;
  return boost;
}

}  // namespace

MipSplattingAdapter::MipSplattingAdapter(const VanillaBoost& boost, Device device)
    : VanillaAdapter(on_sums(boost), device) {}

AdapterEntry mip_splatting_adapter_entry() {
  return {"mip-splatting", [](bool) { return make_settings<MipSplattingAdapter>(VanillaBoost{}); }};
}

}  // namespace splatboost
