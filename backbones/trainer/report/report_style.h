// SPDX-License-Identifier: Apache-2.0
/// @file Style sheet of a report's page.
#pragma once

namespace splatboost::report {

/// CSS. It loads no fonts and no pictures.
extern const char* const kStyle;

}  // namespace splatboost::report
