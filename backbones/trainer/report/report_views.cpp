// SPDX-License-Identifier: Apache-2.0
#include "trainer/report/report_views.h"

#include <algorithm>
#include <cmath>

#include "trainer/images/image_codec.h"
#include "trainer/report/report_markup.h"
#include "trainer/report/report_pictures.h"

namespace splatboost::report {
namespace {

namespace fs = std::filesystem;

// A cell of a view's grid. A picture fills the window while its (invisible) checkbox is checked: no script needed.
std::string picture_cell(const ReportPicture& picture, const std::string& caption, const std::string& swatch,
                         const std::string& kind) {
  std::string out = "<figure class=\"" + kind + "\">";
  if (picture.jpeg.empty()) {
    out += "<div class=\"missing\">no picture</div>";
  } else {
    out += "<label><input type=\"checkbox\" aria-label=\"enlarge " + escape(caption) + "\"/><img width=\"" +
           std::to_string(picture.width) + "\" height=\"" + std::to_string(picture.height) + "\" alt=\"" +
           escape(caption) + "\" src=\"data:image/jpeg;base64," + base64(picture.jpeg) + "\"/></label>";
  }
  out += "<figcaption>";
  if (!swatch.empty()) out += "<i style=\"background:" + swatch + "\"></i>";
  return out + escape(caption) + "</figcaption></figure>\n";
}

const ViewResult* find_view(const Results& results, const std::string& name) {
  const auto at =
      std::find_if(results.views.begin(), results.views.end(), [&](const ViewResult& v) { return v.name == name; });
  return at == results.views.end() ? nullptr : &*at;
}

std::string metric(double value, int digits) { return std::isfinite(value) ? number(value, digits) : "–"; }

// PSNR, SSIM and LPIPS of one view, one row per run.
std::string view_facts(const std::vector<ReportRun>& runs, const std::string& name) {
  std::string rows;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const ViewResult* view = find_view(runs[r].results, name);
    if (!view) continue;
    rows += "<tr><th scope=\"row\"><i style=\"background:" + color_of(r, runs.size()) + "\"></i>" +
            escape(runs[r].label) + "</th><td>" + metric(view->psnr, 2) + "</td><td>" + metric(view->ssim, 4) +
            "</td><td>" + (view->lpips ? metric(*view->lpips, 4) : "–") + "</td></tr>\n";
  }
  if (rows.empty()) return "";
  return "<table class=\"facts\"><thead><tr><th></th><th scope=\"col\">PSNR</th><th scope=\"col\">SSIM</th>"
         "<th scope=\"col\">LPIPS</th></tr></thead><tbody>\n" +
         rows + "</tbody></table>\n";
}

// The same in one line of text, for views whose grid has no free cell.
std::string view_facts_line(const std::vector<ReportRun>& runs, const std::string& name) {
  std::string out;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const ViewResult* view = find_view(runs[r].results, name);
    if (!view) continue;
    out += "<span>";
    if (runs.size() > 1)
      out += "<i style=\"background:" + color_of(r, runs.size()) + "\"></i>" + escape(runs[r].label) + " ";
    out += "PSNR <b>" + metric(view->psnr, 2) + "</b> SSIM <b>" + metric(view->ssim, 4) + "</b>";
    if (view->lpips) out += " LPIPS <b>" + metric(*view->lpips, 4) + "</b>";
    out += "</span>";
  }
  return out.empty() ? out : "<p class=\"legend\">" + out + "</p>";
}

// The colour map as a CSS gradient, read from the map itself.
std::string color_bar() {
  return "<span class=\"bar\">0<i style=\"background:linear-gradient(90deg" + report_error_colors() + ")\"></i>≥ " +
         number(1 / kReportErrorGain, 2) + "</span>";
}

}  // namespace

std::string pictures(const std::vector<ReportRun>& runs, const std::vector<ReportView>& views, int max_views) {
  if (views.empty() || max_views <= 0) return "";
  if (!have_opencv()) {
    return "<section><h2>Pictures</h2>\n<p class=\"note\">This page was written by a build without OpenCV, which "
           "cannot embed pictures; the PNG files are beside it.</p></section>\n";
  }
  std::string out =
      "<section><h2>Pictures</h2>\n<p class=\"note\">Click a picture to enlarge it. Errors are mean absolute "
      "differences of colours in [0, 1]: " +
      color_bar() + "</p>\n";
  for (const std::size_t v : spread(views.size(), static_cast<std::size_t>(max_views))) {
    const ReportView& view = views[v];
    const ReportPicture truth = report_picture(view.truth);
    const bool tall = truth.height > truth.width;
    // One run: truth, render, error. More: errors below their renders, or all in one row where pictures are tall.
    const std::size_t columns = runs.size() == 1 ? 3 : tall ? 1 + 2 * runs.size() : 1 + runs.size();
    const bool facts_in_grid = columns == 1 + runs.size();
    out += "<article class=\"card view\"><div class=\"head\"><h3>" + escape(view.name) + "</h3>" +
           (facts_in_grid ? "" : view_facts_line(runs, view.name)) +
           "</div>\n<div class=\"grid\" style=\"--columns:" + std::to_string(columns) + "\">\n";
    out += picture_cell(truth, "truth", "", "truth");
    std::string errors;
    for (std::size_t r = 0; r < runs.size(); ++r) {
      const fs::path render = runs[r].renders / view.truth.filename();
      const std::string error_name = runs.size() == 1 ? "error" : runs[r].label + " error";
      const std::string color = runs.size() == 1 ? "" : color_of(r, runs.size());
      out += picture_cell(report_picture(render), runs.size() == 1 ? "render" : runs[r].label, color, "render");
      errors += picture_cell(report_error_picture(render, view.truth), error_name, color, "error");
    }
    if (facts_in_grid) out += "<div class=\"cell\">" + view_facts(runs, view.name) + "</div>\n";
    out += errors + "</div></article>\n";
  }
  return out + "</section>\n";
}

std::string moments(const std::vector<ReportRun>& runs) {
  std::string strips;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    const std::vector<fs::path>& files = runs[r].moments;
    if (files.empty() || !have_opencv()) continue;
    strips += "<article class=\"card view\"><div class=\"head\"><h3>" + escape(runs[r].label) +
              "</h3></div>\n<div class=\"grid\" style=\"--columns:" + std::to_string(files.size()) + "\">\n";
    for (std::size_t i = 0; i < files.size(); ++i) {
      const double time = static_cast<double>(i) / static_cast<double>(std::max<std::size_t>(files.size() - 1, 1));
      strips += picture_cell(report_picture(files[i]), "time " + number(time, 2), "", "render");
    }
    strips += "</div></article>\n";
  }
  return strips.empty() ? strips : "<section><h2>Over time</h2>\n" + strips + "</section>\n";
}

std::string surfaces(const std::vector<ReportRun>& runs) {
  if (!have_opencv()) return "";
  std::string out;
  for (const ReportRun& run : runs) {
    for (const ReportSurface& surface : run.surfaces) {
      out += "<article class=\"card view\"><div class=\"head\"><h3>" + escape(surface.name) + "</h3><p>" +
             escape(runs.size() > 1 ? run.label : "") + "</p></div>\n<div class=\"grid\" style=\"--columns:3\">\n" +
             picture_cell(report_picture(surface.truth), "photo", "", "truth") +
             picture_cell(report_depth_picture(surface.depth), "depth", "", "render") +
             picture_cell(report_picture(surface.normals), "normals", "", "render") + "</div></article>\n";
    }
  }
  if (out.empty()) return out;
  return "<section><h2>Surfaces</h2>\n<p class=\"note\">Depth is brighter where it is nearer. Normals are as the "
         "camera sees "
         "them: red to the right, green up, blue towards it.</p>\n" +
         out + "</section>\n";
}

std::string mesh_place() { return "<section id=\"mesh\"></section>\n"; }

std::string mesh_section(const fs::path& picture) {
  return "<section id=\"mesh\"><h2>Mesh</h2>\n<article class=\"card view\"><div class=\"grid\" "
         "style=\"--columns:1\">\n" +
         picture_cell(report_picture(picture), picture.stem().string() + ", shaded by its normals", "", "render") +
         "</div></article></section>\n";
}

std::string all_views(const std::vector<ReportRun>& runs) {
  std::vector<std::string> names;
  for (const ReportRun& run : runs) {
    for (const ViewResult& view : run.results.views) {
      if (std::find(names.begin(), names.end(), view.name) == names.end()) names.push_back(view.name);
    }
  }
  if (names.empty()) return "";
  const std::string span = std::to_string(runs.size());
  std::string out = "<section><details class=\"card\"><summary>All " + std::to_string(names.size()) +
                    " measured views</summary><div class=\"scroll\"><table class=\"views\"><thead>";
  if (runs.size() > 1) {
    out += "<tr><th></th>";
    for (const char* name : {"PSNR", "SSIM", "LPIPS"})
      out += "<th scope=\"colgroup\" colspan=\"" + span + "\">" + name + "</th>";
    out += "</tr>";
  }
  out += "<tr><th scope=\"col\">view</th>";
  for (const char* name : {"PSNR", "SSIM", "LPIPS"}) {
    for (const ReportRun& run : runs)
      out += "<th scope=\"col\">" + (runs.size() > 1 ? escape(run.label) : name) + "</th>";
  }
  out += "</tr></thead><tbody>\n";
  for (const std::string& name : names) {
    out += "<tr><th scope=\"row\">" + escape(name) + "</th>";
    for (int m = 0; m < 3; ++m) {
      for (const ReportRun& run : runs) {
        const ViewResult* view = find_view(run.results, name);
        std::string text = "–";
        if (view && m == 0) text = metric(view->psnr, 2);
        if (view && m == 1) text = metric(view->ssim, 4);
        if (view && m == 2 && view->lpips) text = metric(*view->lpips, 4);
        out += "<td>" + text + "</td>";
      }
    }
    out += "</tr>\n";
  }
  return out + "</tbody></table></div></details></section>\n";
}

}  // namespace splatboost::report
