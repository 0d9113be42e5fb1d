// SPDX-License-Identifier: Apache-2.0
#include <string>

#include "registry/boost_settings.h"
#include "splatboost/errors.h"

namespace splatboost {

const AdapterEntry& find_adapter(std::string_view backbone) {
  std::string names;
  for (const AdapterEntry& entry : adapters()) {
    if (entry.backbone == backbone) return entry;
    names += (names.empty() ? "" : ", ") + std::string(entry.backbone);
  }
  throw ArgumentError("backbone: unknown backbone '" + std::string(backbone.substr(0, 100)) + "'; available: " + names);
}

}  // namespace splatboost
