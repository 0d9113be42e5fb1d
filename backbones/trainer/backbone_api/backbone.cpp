// SPDX-License-Identifier: Apache-2.0
#include "trainer/backbone_api/backbone.h"

#include "trainer/support/input_error.h"

namespace splatboost {

void Backbone::export_moment(float, const std::filesystem::path& file) {
  throw InputError(file.string() + ": this backbone's model does not change with time");
}

}  // namespace splatboost
