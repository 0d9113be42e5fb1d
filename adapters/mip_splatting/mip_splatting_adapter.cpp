// SPDX-License-Identifier: Apache-2.0
#include "mip_splatting/mip_splatting_adapter.h"

#include "registry/boost_settings.h"

namespace splatboost {
namespace {

VanillaBoost on_sums(VanillaBoost boost) {
  if (!boost.literal) boost.gradient_abs_threshold *= kAbsoluteSumOverLength;
  return boost;
}

}  // namespace

MipSplattingAdapter::MipSplattingAdapter(const VanillaBoost& boost, Device device)
    : VanillaAdapter(on_sums(boost), device) {}

AdapterEntry mip_splatting_adapter_entry() {
  return {"mip-splatting", [](bool literal) {
            VanillaBoost boost = literal ? literal_boost() : VanillaBoost{};
            if (literal) boost.schedule = false;  // plain Adam (supplement, Sec. 9.3)
            return make_settings<MipSplattingAdapter>(boost);
          }};
}

}  // namespace splatboost
