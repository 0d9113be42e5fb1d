// SPDX-License-Identifier: Apache-2.0
#include "trainer/report/report_curves.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "trainer/evaluation/result_tables.h"
#include "trainer/report/report_markup.h"

namespace splatboost::report {
namespace {

constexpr std::size_t kLinePoints = 400;  // most points of a curve
constexpr std::size_t kHoverPoints = 60;

struct Point {
  double x = 0;
  double y = 0;
  std::string title;  // tooltip
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
  int end_digits = 0;  // decimals of the last value, unless y_count
};

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
  // Points are drawn after all lines, so that they receive the pointer events.
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
  // Each last value is written right of its point if that is at the chart's right edge, pushed down if it would overlap
  // the one above. Inside the chart, where the other line continues, it is written above the point if there is room.
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
    } else if (end.y < 2 * kTop) {
      end.x += 8;
      end.y += 4;
    } else {
      end.y -= 10;
      anchor = "middle";
    }
    out += "<text class=\"end\" x=\"" + number(end.x, 1) + "\" y=\"" + number(end.y, 1) + "\" text-anchor=\"" + anchor +
           "\" style=\"fill:" + end.color + "\">" + escape(end.words) + "</text>\n";
  }
  return out + "</svg></figure>\n";
}

}  // namespace

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

}  // namespace splatboost::report
