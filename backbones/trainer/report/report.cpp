// SPDX-License-Identifier: Apache-2.0
// The page contains no script, and its content security policy forbids the browser to load anything.
#include "trainer/report/report.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <stdexcept>

#include "trainer/evaluation/result_tables.h"
#include "trainer/images/image_codec.h"
#include "trainer/report/report_curves.h"
#include "trainer/report/report_markup.h"
#include "trainer/report/report_style.h"
#include "trainer/report/report_tracks.h"
#include "trainer/report/report_views.h"
#include "trainer/support/atomic_file.h"

namespace splatboost {
namespace report {
namespace {

std::string verdict_class(ResultRow::Verdict verdict) {
  switch (verdict) {
    case ResultRow::Verdict::kBetter:
      return "better";
    case ResultRow::Verdict::kWorse:
      return "worse";
    case ResultRow::Verdict::kSame:
      return "same";
    case ResultRow::Verdict::kNone:
      break;
  }
  return "none";
}

// The figures a reader looks for first.
std::string headline(const std::vector<ResultRow>& rows, bool compared) {
  std::string out = "<div class=\"tiles\">\n";
  for (const char* label : {"Training time", "PSNR", "Primitives", "Rendering"}) {
    const auto at = std::find_if(rows.begin(), rows.end(), [&](const ResultRow& row) { return row.label == label; });
    if (at == rows.end()) continue;
    const bool change = compared && !at->change.empty();
    out += "<div class=\"card tile\"><h3>" + escape(at->label) + "</h3><p class=\"big\">" +
           escape(change ? at->change : at->values.back()) + "</p>";
    if (change) out += "<p>" + escape(at->values[0]) + " → " + escape(at->values[1]) + "</p>";
    out += "</div>\n";
  }
  return out + "</div>\n";
}

std::string result_table(const std::vector<ReportRun>& runs, const std::vector<ResultRow>& rows) {
  const bool compared = runs.size() == 2;
  std::string out =
      "<section><h2>Results</h2>\n<div class=\"card scroll\"><table class=\"results\"><thead><tr><th></th>";
  for (std::size_t r = 0; r < runs.size(); ++r) {
    out += "<th scope=\"col\"><i style=\"background:" + color_of(r, runs.size()) + "\"></i>" + escape(runs[r].label) +
           "</th>";
  }
  if (compared) out += "<th scope=\"col\">change</th>";
  out += "</tr></thead><tbody>\n";
  for (const ResultRow& row : rows) {
    out += "<tr><th scope=\"row\">" + escape(row.label) + "</th>";
    for (const std::string& value : row.values) out += "<td>" + escape(value) + "</td>";
    if (compared) {
      out +=
          "<td class=\"" + verdict_class(row.verdict) + "\">" + escape(row.change.empty() ? "–" : row.change) + "</td>";
    }
    out += "</tr>\n";
  }
  out +=
      "</tbody></table></div>\n<p class=\"note\">Higher is better for PSNR and SSIM, lower for LPIPS. At β = 1 the "
      "same "
      "model is drawn without the compact box, as viewers of Gaussians do. Training time excludes evaluation and "
      "saving.";
  if (compared) {
    out += " The time to the baseline's PSNR is when the curve first reaches the final value of the baseline's curve.";
  }
  return out + "</p></section>\n";
}

std::string tracking(const std::vector<ReportRun>& runs) {
  std::string lines;
  for (const ReportRun& run : runs) {
    for (const std::string& line : run.tracking) lines += "<p>" + escape(line) + "</p>";
  }
  return lines.empty() ? "" : "<section><h2>Tracking</h2>\n<div class=\"card\">" + lines + "</div></section>\n";
}

std::string stages(const std::vector<ReportRun>& runs) {
  std::map<std::string, double> largest;
  double scale = 0;
  for (const ReportRun& run : runs) {
    for (const auto& [stage, seconds] : run.results.stage_seconds) {
      if (!std::isfinite(seconds)) continue;
      double& most = largest[stage];
      most = std::max(most, seconds);
      scale = std::max(scale, seconds);
    }
  }
  if (!(scale > 0)) return "";
  std::vector<std::string> order;
  for (const auto& [stage, seconds] : largest) order.push_back(stage);
  std::stable_sort(order.begin(), order.end(), [&](const auto& a, const auto& b) { return largest[a] > largest[b]; });
  std::string out = "<section><h2>Where the time goes</h2>\n" + legend(runs) + "<div class=\"card stages\">\n";
  for (const std::string& stage : order) {
    std::string words = stage;
    std::replace(words.begin(), words.end(), '_', ' ');
    out += "<div class=\"stage\"><span>" + escape(words) + "</span><div>";
    for (std::size_t r = 0; r < runs.size(); ++r) {
      const auto at = runs[r].results.stage_seconds.find(stage);
      const bool known = at != runs[r].results.stage_seconds.end() && std::isfinite(at->second);
      out += "<p><i style=\"width:" + number(known ? 100 * at->second / scale : 0, 2) +
             "%;background:" + color_of(r, runs.size()) + "\"></i><b>" +
             (known ? escape(human_seconds(at->second)) : "–") + "</b></p>";
    }
    out += "</div></div>\n";
  }
  return out + "</div></section>\n";
}

std::string how_it_was_run(const std::vector<ReportRun>& runs) {
  std::string out = "<section><h2>How it was run</h2>\n<div class=\"card scroll\"><table class=\"run\">";
  if (runs.size() > 1) {
    out += "<thead><tr><th></th>";
    for (std::size_t r = 0; r < runs.size(); ++r) {
      out += "<th scope=\"col\"><i style=\"background:" + color_of(r, runs.size()) + "\"></i>" + escape(runs[r].label) +
             "</th>";
    }
    out += "</tr></thead>";
  }
  out += "<tbody>\n";
  const auto row = [&](const std::string& label, auto&& value_of, bool code = false) {
    std::vector<std::string> values;
    for (const ReportRun& run : runs) values.push_back(value_of(run.results));
    if (std::all_of(values.begin(), values.end(), [](const std::string& value) { return value.empty(); })) return;
    const auto cell = [&](const std::string& value) {
      return code && !value.empty() ? "<code>" + escape(value) + "</code>" : escape(value.empty() ? "–" : value);
    };
    out += "<tr><th scope=\"row\">" + label + "</th>";
    // A value that all runs share is shown once.
    if (std::set<std::string>(values.begin(), values.end()).size() == 1) {
      out += "<td colspan=\"" + std::to_string(runs.size()) + "\">" + cell(values[0]) + "</td>";
    } else {
      for (const std::string& value : values) out += "<td>" + cell(value) + "</td>";
    }
    out += "</tr>\n";
  };
  row(
      "Command", [](const Results& r) { return r.command; }, true);
  row("Scene", [](const Results& r) { return r.source; });
  row("Image size",
      [](const Results& r) { return r.width > 0 ? std::to_string(r.width) + " × " + std::to_string(r.height) : ""; });
  row("Measured on", [](const Results& r) {
    if (r.views.empty()) return std::string();
    return std::to_string(r.views.size()) + " " + (r.split.empty() ? "" : r.split + " ") +
           (r.views.size() == 1 ? "view" : "views");
  });
  row("Backbone", [](const Results& r) { return r.backbone; });
  row("Acceleration", [](const Results& r) { return std::string(r.boost ? "on" : "off"); });
  row("Iterations",
      [](const Results& r) { return human_count(static_cast<std::uint64_t>(std::max(0, r.iterations))); });
  row("Machine", [](const Results& r) { return r.machine; });
  row("Device", [](const Results& r) { return r.device; });
  row("Threads", [](const Results& r) { return std::to_string(r.threads); });
  row("Seed", [](const Results& r) { return std::to_string(r.seed); });
  row("Version", [](const Results& r) { return r.version; });
  row("Date", [](const Results& r) { return human_date(r.date); });
  return out + "</tbody></table></div></section>\n";
}

}  // namespace
}  // namespace report

void write_report(const std::filesystem::path& path, const std::string& title, const std::vector<ReportRun>& runs,
                  const std::vector<ReportView>& views, int max_views, const std::vector<ReportTrack>& tracks) {
  using namespace report;
  if (runs.empty()) throw std::invalid_argument("write_report: no runs");
  std::vector<Results> results;
  for (const ReportRun& run : runs) results.push_back(run.results);
  const std::vector<ResultRow> rows = result_rows(results);
  const Results& first = results.front();

  std::string page =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"/>\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; style-src "
      "'unsafe-inline'\"/>\n"
      "<link rel=\"icon\" href=\"data:,\"/>\n<title>" +
      escape(title) + "</title>\n<style>" + kStyle + "</style></head>\n<body><main>\n";
  page += "<header><p class=\"kind\">SplatBoost " + std::string(runs.size() > 1 ? "comparison" : "training") +
          " report</p><h1>" + escape(title) + "</h1><p>";
  std::vector<std::string> facts = {first.backbone, first.source};
  if (first.width > 0) facts.push_back(std::to_string(first.width) + " × " + std::to_string(first.height));
  if (first.iterations > 0) facts.push_back(human_count(static_cast<std::uint64_t>(first.iterations)) + " iterations");
  facts.push_back(first.machine);
  facts.push_back(first.date.substr(0, 10));
  std::string separator;
  for (const std::string& fact : facts) {
    if (fact.empty()) continue;
    page += separator + escape(fact);
    separator = " · ";
  }
  page += "</p></header>\n";
  page += headline(rows, runs.size() == 2) + result_table(runs, rows) + tracking(runs) + curves(runs) +
          (tracks.empty() ? tracks_of_page(path) : report::tracks(tracks)) + pictures(runs, views, max_views) +
          surfaces(runs) + (runs.size() == 1 ? mesh_place() : "") + moments(runs) + stages(runs) +
          how_it_was_run(runs) + all_views(runs);
  page +=
      "<footer><p>Look around in a browser: in the folder of this page, <code>python -m splatboost view .</code></p>"
      "<p>Made by SplatBoost " +
      escape(first.version) + ".</p></footer>\n</main></body></html>\n";
  write_text_atomically(path, page);
}

void show_mesh_in_report(const std::filesystem::path& path, const std::filesystem::path& picture) {
  if (!have_opencv() || !std::filesystem::is_regular_file(path)) return;
  std::ifstream in(path, std::ios::binary);
  std::string page{std::istreambuf_iterator<char>(in), {}};
  const std::string place = report::mesh_place(), end = "</section>\n";
  const std::string begin = place.substr(0, place.size() - end.size());
  const std::size_t at = page.find(begin);
  if (at == std::string::npos) return;
  const std::size_t after = page.find(end, at);
  if (after == std::string::npos) return;
  page.replace(at, after + end.size() - at, report::mesh_section(picture));
  write_text_atomically(path, page);
}

}  // namespace splatboost
