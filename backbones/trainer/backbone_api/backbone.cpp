// SPDX-License-Identifier: Apache-2.0
#include "trainer/backbone_api/backbone.h"

#include "trainer/support/input_error.h"

namespace splatboost {

void depths_of_inverse(std::span<const float> alpha, std::span<float> depth) {
  for (std::size_t p = 0; p < depth.size(); ++p) depth[p] = depth[p] > 0 ? alpha[p] / depth[p] : 0.0f;
}

void Backbone::export_moment(float, const std::filesystem::path& file) {
  throw InputError(file.string() + ": this backbone's model does not change with time");
}

}  // namespace splatboost
