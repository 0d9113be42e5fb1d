// SPDX-License-Identifier: Apache-2.0
// The page is written as XML that is also HTML5 (every element closed, every attribute quoted), so that any XML parser
// can check it. It holds no script, and its content policy forbids the browser to load anything.
#include "common/report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <set>
#include <span>
#include <stdexcept>

#include "common/atomic_file.h"
#include "common/image_codec.h"
#include "common/report_pictures.h"

namespace splatboost {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLinePoints = 400;  // of a curve
constexpr std::size_t kHoverPoints = 60;

// --- text

std::string escape(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\'':
        out += "&#39;";
        break;
      default:
        // Control characters are not allowed in XML, and show nothing in HTML.
        if (static_cast<unsigned char>(c) >= 0x20 || c == '\n' || c == '\t') out += c;
    }
  }
  return out;
}

std::string number(double value, int digits) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", digits, value);
  return text;
}

std::string base64(std::span<const std::uint8_t> bytes) {
  static constexpr char kAlphabet[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) group = group << 8 | (k < count ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) out += k <= count ? kAlphabet[group >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

// 2026-01-31T12:00:00Z as 2026-01-31 12:00:00 UTC; anything else as it is.
std::string human_date(std::string date) {
  if (date.size() != 20 || date[10] != 'T' || date[19] != 'Z') return date;
  date[10] = ' ';
  return date.substr(0, 19) + " UTC";
}

// Grey for what is known, blue for what is new: apart for every kind of colour vision, and in print.
std::string color_of(std::size_t run, std::size_t runs) {
  static const std::array<std::string, 5> kColors = {"#6f7a8b", "#1668dc", "#c2570c", "#0f8a6d", "#8b45c4"};
  return runs == 1 ? kColors[1] : kColors[run % kColors.size()];
}

std::string legend(const std::vector<ReportRun>& runs) {
  if (runs.size() < 2) return "";
  std::string out = "<p class=\"legend\">";
  for (std::size_t i = 0; i < runs.size(); ++i) {
    out += "<span><i style=\"background:" + color_of(i, runs.size()) + "\"></i>" + escape(runs[i].label) + "</span>";
  }
  return out + "</p>\n";
}

// --- curves

struct Point {
  double x = 0;
  double y = 0;
  std::string title;  // shown while the pointer rests on it
};

struct Series {
  std::string color;
  std::vector<Point> points;
};

struct Axis {
  double low = 0;
  double high = 1;
  double step = 1;
};

// Ticks at 1, 2 or 5 times a power of ten, about `ticks` of them. `tight` ends the axis with the data.
Axis make_axis(double low, double high, int ticks, bool tight) {
  if (!(high > low)) {
    const double margin = std::max(std::abs(high) * 0.05, 0.5);
    if (low != 0) low -= margin;
    high += margin;
  }
  const double raw = (high - low) / ticks;
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  const double fraction = raw / power;
  const double step = power * (fraction <= 1.2 ? 1 : fraction <= 2.5 ? 2 : fraction <= 6 ? 5 : 10);
  if (tight) return {low, high, step};
  return {std::floor(low / step + 1e-9) * step, std::ceil(high / step - 1e-9) * step, step};
}

std::string tick_text(double value, double step, bool count) {
  if (!count) return number(value, std::clamp(static_cast<int>(std::ceil(-std::log10(step) - 1e-9)), 0, 6));
  const auto scaled = [&](double unit, const char* suffix) {
    const double s = step / unit;
    return number(value / unit, s >= 1 ? 0 : s >= 0.1 ? 1 : 2) + suffix;
  };
  if (value == 0) return "0";
  if (value >= 1e6) return scaled(1e6, "M");
  if (value >= 1e3) return scaled(1e3, "k");
  return number(value, 0);
}

struct Chart {
  std::string title;
  std::string y_unit;
  std::string x_title;
  std::vector<Series> series;
  bool x_count = false;  // ticks as 10k
  bool y_count = false;
  bool y_from_zero = false;
  int end_digits = 0;  // of the last value, where it is no count
};

// At most `limit` indices of `count`, evenly spread, first and last among them.
std::vector<std::size_t> spread(std::size_t count, std::size_t limit) {
  std::vector<std::size_t> out;
  if (count <= limit) {
    for (std::size_t i = 0; i < count; ++i) out.push_back(i);
  } else if (limit == 1) {
    out.push_back(0);
  } else {
    for (std::size_t i = 0; i < limit; ++i) out.push_back(i * (count - 1) / (limit - 1));
  }
  return out;
}

// Empty for a chart without points.
std::string draw(const Chart& chart) {
  // In SVG units; the drawing scales with the page. The margins hold the larger text of phones.
  constexpr double kWidth = 540, kHeight = 300, kLeft = 56, kRight = 66, kTop = 14, kBottom = 46;
  std::string out = "<figure class=\"card chart\"><figcaption>" + escape(chart.title);
  if (!chart.y_unit.empty()) out += " <small>" + escape(chart.y_unit) + "</small>";
  out += "</figcaption>\n";

  double x_high = 0, y_low = INFINITY, y_high = -INFINITY;
  for (const Series& series : chart.series) {
    for (const Point& point : series.points) {
      x_high = std::max(x_high, point.x);
      y_low = std::min(y_low, point.y);
      y_high = std::max(y_high, point.y);
    }
  }
  if (!(y_high >= y_low)) return "";
  if (chart.y_from_zero) y_low = 0;
  const Axis x_axis = make_axis(0, x_high, 6, true);
  const Axis y_axis = make_axis(y_low, y_high, 5, false);
  const auto x_of = [&](double x) {
    return kLeft + (x - x_axis.low) / (x_axis.high - x_axis.low) * (kWidth - kLeft - kRight);
  };
  const auto y_of = [&](double y) {
    return kHeight - kBottom - (y - y_axis.low) / (y_axis.high - y_axis.low) * (kHeight - kTop - kBottom);
  };
  const auto text = [&](double x, double y, const std::string& attributes, const std::string& words) {
    out +=
        "<text x=\"" + number(x, 1) + "\" y=\"" + number(y, 1) + "\" " + attributes + ">" + escape(words) + "</text>\n";
  };

  out += "<svg viewBox=\"0 0 " + number(kWidth, 0) + " " + number(kHeight, 0) + "\" role=\"img\" aria-label=\"" +
         escape(chart.title) + "\">\n";
  const int y_ticks = static_cast<int>(std::lround((y_axis.high - y_axis.low) / y_axis.step));
  for (int i = 0; i <= y_ticks; ++i) {
    const double value = y_axis.low + i * y_axis.step;
    const std::string y = number(y_of(value), 1);
    out += "<line class=\"" + std::string(i == 0 ? "axis" : "grid") + "\" x1=\"" + number(kLeft, 0) + "\" x2=\"" +
           number(kWidth - kRight, 0) + "\" y1=\"" + y + "\" y2=\"" + y + "\"/>\n";
    text(kLeft - 8, y_of(value) + 4, "text-anchor=\"end\"", tick_text(value, y_axis.step, chart.y_count));
  }
  for (int i = 0; i * x_axis.step <= x_axis.high * (1 + 1e-9); ++i) {
    const std::string x = number(x_of(i * x_axis.step), 1);
    const std::string y = number(kHeight - kBottom, 0);
    out += "<line class=\"axis\" x1=\"" + x + "\" x2=\"" + x + "\" y1=\"" + y + "\" y2=\"" +
           number(kHeight - kBottom + 5, 0) + "\"/>\n";
    text(x_of(i * x_axis.step), kHeight - kBottom + 20, "text-anchor=\"middle\"",
         tick_text(i * x_axis.step, x_axis.step, chart.x_count));
  }
  text((kLeft + kWidth - kRight) / 2, kHeight - 6, "text-anchor=\"middle\"", chart.x_title);

  struct End {
    double x = 0, y = 0;
    std::string words, color;
  };
  std::vector<End> ends;
  for (const Series& series : chart.series) {
    if (series.points.empty()) continue;
    std::string path;
    for (const std::size_t i : spread(series.points.size(), kLinePoints)) {
      path +=
          (path.empty() ? "M" : "L") + number(x_of(series.points[i].x), 1) + " " + number(y_of(series.points[i].y), 1);
    }
    out += "<path class=\"line\" stroke=\"" + series.color + "\" d=\"" + path + "\"/>\n";
    const Point& last = series.points.back();
    ends.push_back({x_of(last.x), y_of(last.y),
                    chart.y_count ? tick_text(last.y, y_axis.step / 10, true) : number(last.y, chart.end_digits),
                    series.color});
  }
  // Points above all lines: what is drawn later takes the pointer.
  for (const Series& series : chart.series) {
    const bool few = series.points.size() <= 12;
    for (const std::size_t i : spread(series.points.size(), kHoverPoints)) {
      const Point& point = series.points[i];
      const bool shown = few || i + 1 == series.points.size();
      const std::string at = "cx=\"" + number(x_of(point.x), 1) + "\" cy=\"" + number(y_of(point.y), 1) + "\"";
      out += "<g class=\"point" + std::string(shown ? " shown" : "") + "\" fill=\"" + series.color +
             "\"><circle class=\"hit\" " + at + " r=\"9\"/><circle class=\"dot\" " + at + " r=\"3.5\"/><title>" +
             escape(point.title) + "</title></g>\n";
    }
  }
  // The last values stand right of their points at the chart's edge, pushed apart where they would overlap, and above
  // points inside the chart, where the other line goes on.
  std::stable_sort(ends.begin(), ends.end(), [](const End& a, const End& b) { return a.y < b.y; });
  End* above = nullptr;
  for (End& end : ends) {
    const bool at_edge = end.x > kWidth - kRight - 40;
    std::string anchor = "start";
    if (at_edge) {
      end.x += 8;
      end.y += 4;
      // 18 units keep the larger text of phones apart too.
      if (above && end.y < above->y + 18) end.y = above->y + 18;
      above = &end;
    } else {
      end.y -= 10;
      anchor = "middle";
    }
    out += "<text class=\"end\" x=\"" + number(end.x, 1) + "\" y=\"" + number(end.y, 1) + "\" text-anchor=\"" + anchor +
           "\" style=\"fill:" + end.color + "\">" + escape(end.words) + "</text>\n";
  }
  return out + "</svg></figure>\n";
}

std::string curves(const std::vector<ReportRun>& runs) {
  bool any = false;
  double longest = 0;
  for (const ReportRun& run : runs) {
    any = any || !run.results.curve.empty();
    for (const CurvePoint& point : run.results.curve) longest = std::max(longest, point.seconds);
  }
  if (!any) return "";
  const double unit = longest <= 180 ? 1 : longest <= 3 * 3600 ? 60 : 3600;
  const std::string unit_name = unit == 1 ? "s" : unit == 60 ? "min" : "h";

  // Quality is PSNR where it was measured during the run, else the loss.
  const bool measured = std::any_of(runs.begin(), runs.end(), [](const ReportRun& run) {
    return std::any_of(run.results.curve.begin(), run.results.curve.end(),
                       [](const auto& p) { return p.psnr.has_value(); });
  });
  const std::string quality = measured ? "Quality" : "Training loss";
  const std::string quality_unit = measured ? "PSNR in dB" : "";
  const std::string time_title = "training time in " + unit_name;
  Chart quality_time{quality + " over time", quality_unit, time_title, {}};
  Chart quality_iteration{quality + " over iterations", quality_unit, "iteration", {}, true};
  Chart primitives{"Primitives", "", "iteration", {}, true, true, true};
  Chart time{"Training time", "in " + unit_name, "iteration", {}, true, false, true};
  quality_time.y_from_zero = quality_iteration.y_from_zero = !measured;
  quality_time.end_digits = quality_iteration.end_digits = measured ? 2 : 3;
  time.end_digits = unit > 1 ? 1 : 0;
  for (std::size_t r = 0; r < runs.size(); ++r) {
    for (Chart* chart : {&quality_time, &quality_iteration, &primitives, &time}) {
      chart->series.push_back({color_of(r, runs.size()), {}});
    }
    for (const CurvePoint& point : runs[r].results.curve) {
      const auto add = [&](Chart& chart, double x, double y, const std::string& words) {
        if (!std::isfinite(x) || !std::isfinite(y)) return;
        const std::string label = runs.size() > 1 ? runs[r].label + " · " : "";
        const auto iteration = static_cast<std::uint64_t>(std::max(0, point.iteration));
        chart.series.back().points.push_back(
            {x, y, label + words + "\niteration " + human_count(iteration) + ", " + human_seconds(point.seconds)});
      };
      if (point.psnr || !measured) {
        const double value = measured ? *point.psnr : point.loss;
        const std::string words = measured ? number(value, 2) + " dB" : "loss " + number(value, 4);
        add(quality_time, point.seconds / unit, value, words);
        add(quality_iteration, point.iteration, value, words);
      }
      const auto count = static_cast<double>(point.primitives);
      add(primitives, point.iteration, count, human_count(point.primitives) + " primitives");
      add(time, point.iteration, point.seconds / unit, human_seconds(point.seconds));
    }
  }
  return "<section><h2>Training</h2>\n" + legend(runs) + "<div class=\"charts\">\n" + draw(quality_time) +
         draw(quality_iteration) + draw(primitives) + draw(time) + "</div></section>\n";
}

// --- pictures

// A cell of a view's grid. A picture grows to the window while its (invisible) checkbox is checked: no script needed.
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

// PSNR, SSIM, LPIPS of one view, a line a run.
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

// The same in one line of text, for views whose grid has no cell to spare.
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

std::string pictures(const std::vector<ReportRun>& runs, const std::vector<ReportView>& views, int max_views) {
  if (views.empty() || max_views <= 0) return "";
  if (!have_opencv()) {
    return "<section><h2>Pictures</h2>\n<p class=\"note\">This page was written by a build without OpenCV, which "
           "embeds "
           "none; the PNG files are beside it.</p></section>\n";
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

// --- tables

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
      "</tbody></table></div>\n<p class=\"note\">Higher is better for PSNR and SSIM, lower for LPIPS. “In any viewer” "
      "is the same "
      "model drawn without the compact box. Training time leaves out evaluation and saving.</p></section>\n";
  return out;
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
    // What all runs share is said once.
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

constexpr char kStyle[] = R"css(
:root { color-scheme: light; --ink: #17202e; --soft: #5b6677; --line: #e3e7ee; --paper: #ffffff; --ground: #f5f7fa;
  --good: #0b7a45; --bad: #a8480f; --accent: #1668dc; }
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink); font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto,
  "Noto Sans", "Helvetica Neue", "DejaVu Sans", sans-serif; font-variant-numeric: tabular-nums; -webkit-text-size-adjust: 100%; }
main { max-width: 1180px; margin: 0 auto; padding: 40px 24px 64px; }
header p { margin: 0; color: var(--soft); }
header .kind { color: var(--accent); font-weight: 600; font-size: 13px; letter-spacing: .04em; }
h1 { font-size: 30px; line-height: 1.2; margin: 4px 0 6px; letter-spacing: -.015em; overflow-wrap: anywhere; }
h2 { font-size: 20px; margin: 44px 0 12px; letter-spacing: -.01em; }
h3 { font-size: 14px; margin: 0; overflow-wrap: anywhere; }
small { color: var(--soft); font-weight: 400; font-size: 13px; }
.card { background: var(--paper); border: 1px solid var(--line); border-radius: 12px; }
.note { color: var(--soft); font-size: 13px; margin: 10px 2px; }
.tiles { display: grid; grid-template-columns: repeat(4, minmax(0, 1fr)); gap: 16px; margin-top: 28px; }
.tile { padding: 16px 20px; }
.tile h3 { color: var(--soft); font-weight: 500; }
.tile p { margin: 0; color: var(--soft); font-size: 13px; }
.tile .big { color: var(--ink); font-size: 27px; font-weight: 650; letter-spacing: -.02em; line-height: 1.35; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; }
th, td { padding: 9px 20px; text-align: right; white-space: nowrap; }
th { font-weight: 500; }
tbody th, .run td { text-align: left; }
thead th { color: var(--soft); font-size: 13px; }
tbody tr { border-top: 1px solid var(--line); }
table.results tbody tr:first-child td { font-weight: 650; }
.better { color: var(--good); font-weight: 600; }
.worse { color: var(--bad); font-weight: 600; }
.same { color: var(--soft); }
.run thead th { text-align: left; }
.run th { color: var(--soft); vertical-align: top; width: 1%; }
.run thead th { width: auto; }
.run td { white-space: normal; overflow-wrap: anywhere; }
code { font: 13px/1.5 ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace; }
th i, .legend i, figcaption i { display: inline-block; width: 10px; height: 10px; border-radius: 3px; margin-right: 7px; }
.legend { margin: 0 2px 12px; display: flex; flex-wrap: wrap; gap: 4px 20px; font-size: 13px; }
.charts { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 16px; }
figure { margin: 0; min-width: 0; }
.chart { padding: 16px 12px 8px; }
.chart figcaption { font-weight: 600; font-size: 14px; padding: 0 8px 6px; }
svg { display: block; width: 100%; height: auto; }
svg text { font-size: 12px; fill: var(--soft); }
svg .end { font-weight: 650; paint-order: stroke; stroke: #ffffff; stroke-width: 4px; stroke-linejoin: round; }
svg .grid { stroke: var(--line); }
svg .axis { stroke: #b4bcc8; }
svg .line { fill: none; stroke-width: 2.25; stroke-linejoin: round; stroke-linecap: round; }
svg .hit { fill-opacity: 0; }
svg .dot { opacity: 0; stroke: #ffffff; stroke-width: 1.5; }
svg .shown .dot, svg .point:hover .dot { opacity: 1; }
.bar { white-space: nowrap; }
.bar i { display: inline-block; width: 96px; height: 10px; border-radius: 5px; margin: 0 6px; }
.view { padding: 16px 20px 20px; margin-bottom: 16px; }
.view .grid { display: grid; grid-template-columns: repeat(var(--columns), minmax(0, 1fr)); gap: 14px; margin-top: 12px; }
.view figcaption { font-size: 13px; color: var(--soft); margin-top: 4px; }
.view img { display: block; width: 100%; height: auto; border-radius: 6px; background: #0c1018; }
.view label { display: block; cursor: zoom-in; }
.view input { position: absolute; opacity: 0; }
.view input:focus-visible + img { outline: 3px solid var(--accent); outline-offset: 2px; }
.view input:checked + img { position: fixed; inset: 0; z-index: 9; width: 100vw; height: 100vh; object-fit: contain;
  border-radius: 0; background: rgba(12, 16, 24, .96); cursor: zoom-out; }
.missing { display: grid; place-items: center; min-height: 120px; height: calc(100% - 26px); border-radius: 6px;
  background: var(--ground); color: var(--soft); font-size: 13px; }
.cell { display: flex; align-items: center; }
.view .head { display: flex; flex-wrap: wrap; justify-content: space-between; gap: 4px 24px; }
.view .legend { margin: 0; color: var(--soft); }
.view .legend b { color: var(--ink); font-weight: 600; margin-right: 4px; }
.facts { font-size: 13px; margin: 0 0 26px; }
.facts th, .facts td { padding: 6px 12px; }
.facts th:first-child { padding-left: 0; }
.stages { padding: 14px 20px; }
.stage { display: grid; grid-template-columns: 170px 1fr; align-items: center; padding: 7px 0; }
.stage + .stage { border-top: 1px solid var(--line); }
.stage p { margin: 0; display: flex; align-items: center; gap: 8px; padding-right: 92px; line-height: 1.45; }
.stage i { display: block; height: 10px; border-radius: 2px 5px 5px 2px; min-width: 2px; }
.stage b { font-weight: 500; font-size: 13px; white-space: nowrap; margin-right: -92px; }
details { margin-top: 16px; }
details summary { cursor: pointer; padding: 14px 20px; font-weight: 600; }
footer { margin-top: 44px; color: var(--soft); font-size: 13px; }
@media (max-width: 900px) { .charts { grid-template-columns: minmax(0, 1fr); }
  .tiles { grid-template-columns: repeat(2, minmax(0, 1fr)); } }
@media (max-width: 640px) {
  main { padding: 24px 14px 48px; }
  h1 { font-size: 24px; }
  .tiles { gap: 10px; }
  .tile { padding: 12px 14px; }
  .tile .big { font-size: 21px; }
  th, td { padding: 8px 10px; }
  table.results { font-size: 13px; }
  table.results th { white-space: normal; }
  svg text { font-size: 16px; }
  .view { padding: 14px; }
  .view .grid { grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 10px; }
  .view .truth, .view .cell { grid-column: 1 / -1; }
  .view .cell { order: -1; }
  .facts { margin: 0; }
  .stage { grid-template-columns: minmax(0, 1fr); }
}
@media print { body { background: #ffffff; } .card { break-inside: avoid; } }
)css";

}  // namespace

void write_report(const fs::path& path, const std::string& title, const std::vector<ReportRun>& runs,
                  const std::vector<ReportView>& views, int max_views) {
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
  page += headline(rows, runs.size() == 2) + result_table(runs, rows) + curves(runs) +
          pictures(runs, views, max_views) + stages(runs) + how_it_was_run(runs) + all_views(runs);
  page += "<footer>Made by SplatBoost " + escape(first.version) + ".</footer>\n</main></body></html>\n";
  write_text_atomically(path, page);
}

}  // namespace splatboost
