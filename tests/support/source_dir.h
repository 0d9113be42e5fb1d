// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace splatboost::test {

/// The folder of this source tree.
std::filesystem::path source_dir();

}  // namespace splatboost::test
