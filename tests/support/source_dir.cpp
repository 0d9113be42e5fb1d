// SPDX-License-Identifier: Apache-2.0
#include "support/source_dir.h"

namespace splatboost::test {

std::filesystem::path source_dir() { return SPLATBOOST_SOURCE_DIR; }

}  // namespace splatboost::test
