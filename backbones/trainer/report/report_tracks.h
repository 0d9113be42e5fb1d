// SPDX-License-Identifier: Apache-2.0
/// @file Camera paths projected onto a plane, as inline SVG.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "trainer/report/report.h"

namespace splatboost::report {

/// The section of the paths; empty if there are none.
std::string tracks(const std::vector<ReportTrack>& tracks);

/// That section of an existing page; empty if the page or the section does not exist.
std::string tracks_of_page(const std::filesystem::path& page);

}  // namespace splatboost::report
