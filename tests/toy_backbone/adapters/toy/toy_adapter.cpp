// SPDX-License-Identifier: Apache-2.0
// The adapter of a tenth backbone: vanilla's rules with a different β.
#include "registry/boost_settings.h"
#include "vanilla/vanilla_adapter.h"

namespace splatboost {

AdapterEntry toy_adapter_entry() {
  return {"toy", [](bool) {
            VanillaBoost boost;
            boost.beta = 0.8f;
            return make_settings<VanillaAdapter>(boost);
          }};
}

}  // namespace splatboost
