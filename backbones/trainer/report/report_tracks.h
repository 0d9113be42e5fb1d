// SPDX-License-Identifier: Apache-2.0
/// @file The paths of a moving camera, seen from one side, as inline SVG.
#pragma once

#include <string>
#include <vector>

#include "trainer/report/report.h"

namespace splatboost::report {

/// The section; empty where there is no path.
std::string tracks(const std::vector<ReportTrack>& tracks);

}  // namespace splatboost::report
