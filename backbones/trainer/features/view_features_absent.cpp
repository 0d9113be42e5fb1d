// SPDX-License-Identifier: Apache-2.0
#include "trainer/features/view_features.h"

namespace splatboost {

ViewFeatures detect_features(const View& view) { return grey_view(view); }

}  // namespace splatboost
