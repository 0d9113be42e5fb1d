// SPDX-License-Identifier: Apache-2.0
/// @file The curves of a report: quality, primitives and time over a run, as inline SVG.
#pragma once

#include <string>
#include <vector>

#include "trainer/report/report.h"

namespace splatboost::report {

/// The section of the curves; empty if no run has one.
std::string curves(const std::vector<ReportRun>& runs);

}  // namespace splatboost::report
