// SPDX-License-Identifier: Apache-2.0
/// @file report.html: one self-contained page that opens from disk with no network.
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "trainer/evaluation/results.h"

namespace splatboost {

/// The surface seen from a view, as PNGs.
struct ReportSurface {
  std::string name;               ///< name of the view
  std::filesystem::path truth;    ///< the photo
  std::filesystem::path depth;    ///< grey, nearer is brighter
  std::filesystem::path normals;  ///< x, y, z as colours
};

/// One run in a report, and where its test renders are.
struct ReportRun {
  std::string label;  ///< "baseline", "boosted"
  Results results;
  std::filesystem::path renders;  ///< folder of PNG renders, named like the views' truth files
  /// PNGs of one camera at times from 0 to 1, evenly spread; empty: the model does not change with time.
  std::vector<std::filesystem::path> moments;
  std::vector<ReportSurface> surfaces = {};  ///< of some views; empty: it was not trained for surfaces
  std::vector<std::string> tracking = {};    ///< lines on how a camera was tracked; empty: none was
};

/// One measured view: its truth as a PNG on disk.
struct ReportView {
  std::string name;             ///< as in Results::views
  std::filesystem::path truth;  ///< PNG; the renders of the view have its file name
};

/// A camera path projected onto a plane: lengths to the right and up; NaN where it is unknown.
struct ReportTrack {
  std::string label;
  std::vector<std::array<double, 2>> points;
  std::string unit = "m";  ///< of the lengths, the same for all paths of a report; empty: unknown
};

/// Writes the page: the table, curves of PSNR, primitives and time, the camera paths (inline SVG), and for up to
/// `max_views` views the pictures truth | each run's render | each run's error (embedded as data URIs). Written to a
/// temporary file, then renamed. Without `tracks`, the camera paths of the page that is replaced are kept.
void write_report(const std::filesystem::path& path, const std::string& title, const std::vector<ReportRun>& runs,
                  const std::vector<ReportView>& views, int max_views = 4, const std::vector<ReportTrack>& tracks = {});

/// Inserts the picture of a mesh into the page of one run, replacing an earlier one. Does nothing if the page or the
/// picture does not exist.
void show_mesh_in_report(const std::filesystem::path& path, const std::filesystem::path& picture);

}  // namespace splatboost
