// SPDX-License-Identifier: Apache-2.0
/// @file Parts of a report about the measured views: pictures and metrics of each.
#pragma once

#include <string>
#include <vector>

#include "trainer/report/report.h"

namespace splatboost::report {

/// Up to `max_views` views as truth | each run's render | each run's error, with their metrics.
std::string pictures(const std::vector<ReportRun>& runs, const std::vector<ReportView>& views, int max_views);

/// One camera at several times, one strip per run; empty if no model changes with time.
std::string moments(const std::vector<ReportRun>& runs);

/// Surfaces of some views as photo | depth | normals; empty if no run was trained for surfaces.
std::string surfaces(const std::vector<ReportRun>& runs);

/// The placeholder for the picture of a mesh, and the section that replaces it.
std::string mesh_place();
std::string mesh_section(const std::filesystem::path& picture);

/// The metrics of every view, collapsed by default.
std::string all_views(const std::vector<ReportRun>& runs);

}  // namespace splatboost::report
