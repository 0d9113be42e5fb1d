// SPDX-License-Identifier: Apache-2.0
/// @file report.html: one self-contained page that opens from disk with no network.
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "trainer/evaluation/results.h"

namespace splatboost {

/// One run in a report, and where its test renders are.
struct ReportRun {
  std::string label;  ///< "baseline", "boosted"
  Results results;
  std::filesystem::path renders;  ///< folder of PNG renders, named as the views' truth files
};

/// One measured view: its truth as a PNG on disk.
struct ReportView {
  std::string name;             ///< as in Results::views
  std::filesystem::path truth;  ///< PNG; the renders of the view have its file name
};

/// A path of a camera, seen from one side: metres to the right and up; NaN where it is not known.
struct ReportTrack {
  std::string label;
  std::vector<std::array<double, 2>> points;
};

/// Writes the page: the table, curves of PSNR, primitives and time and the paths (inline SVG), and for up to
/// `max_views` views the pictures truth | each run's render | each run's error (embedded as data URIs). Written aside,
/// then renamed.
void write_report(const std::filesystem::path& path, const std::string& title, const std::vector<ReportRun>& runs,
                  const std::vector<ReportView>& views, int max_views = 4, const std::vector<ReportTrack>& tracks = {});

}  // namespace splatboost
