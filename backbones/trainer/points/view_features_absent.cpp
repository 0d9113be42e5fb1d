// SPDX-License-Identifier: Apache-2.0
#include "trainer/points/view_features.h"

namespace splatboost {

ViewFeatures detect_features(const View& view) {
  ViewFeatures features;
  features.view = &view;
  return features;
}

}  // namespace splatboost
