// SPDX-License-Identifier: Apache-2.0
/// @file How a report's page looks.
#pragma once

namespace splatboost::report {

/// CSS. It names no font to load and no picture.
extern const char* const kStyle;

}  // namespace splatboost::report
