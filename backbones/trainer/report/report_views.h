// SPDX-License-Identifier: Apache-2.0
/// @file What a report shows of the measured views: pictures and figures of each.
#pragma once

#include <string>
#include <vector>

#include "trainer/report/report.h"

namespace splatboost::report {

/// Up to `max_views` views as truth | each run's render | each run's error, with their figures.
std::string pictures(const std::vector<ReportRun>& runs, const std::vector<ReportView>& views, int max_views);

/// One camera at several times, a strip a run; empty where no model changes with time.
std::string moments(const std::vector<ReportRun>& runs);

/// Surfaces of some views as photo | depth | normals; empty where no run was trained for surfaces.
std::string surfaces(const std::vector<ReportRun>& runs);

/// Where the picture of a mesh goes once there is one, and what goes there.
std::string mesh_place();
std::string mesh_section(const std::filesystem::path& picture);

/// The figures of every view, folded away.
std::string all_views(const std::vector<ReportRun>& runs);

}  // namespace splatboost::report
