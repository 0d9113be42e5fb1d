// SPDX-License-Identifier: Apache-2.0
// A tenth backbone's adapter: vanilla's rules with another β.
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
