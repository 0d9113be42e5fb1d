// SPDX-License-Identifier: Apache-2.0
/// @file Camera paths projected onto a plane, as inline SVG.
#pragma once

#include <string>
#include <vector>

#include "trainer/report/report.h"

namespace splatboost::report {

/// The section of the paths; empty if there are none.
std::string tracks(const std::vector<ReportTrack>& tracks);

}  // namespace splatboost::report
