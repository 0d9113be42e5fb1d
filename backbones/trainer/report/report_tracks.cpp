// SPDX-License-Identifier: Apache-2.0
#include "trainer/report/report_tracks.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <string_view>

#include "trainer/report/report_markup.h"

namespace splatboost::report {
namespace {

constexpr char kBegin[] = "<section><h2>Where the camera was</h2>\n", kEnd[] = "</section>\n";

}  // namespace

std::string tracks(const std::vector<ReportTrack>& tracks) {
  constexpr double kWidth = 720, kMargin = 12, kTallest = 540, kBarRoom = 28;
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double low[2] = {kInfinity, kInfinity}, high[2] = {-kInfinity, -kInfinity};
  for (const ReportTrack& track : tracks) {
    for (const std::array<double, 2>& point : track.points) {
      for (std::size_t c = 0; c < 2; ++c) {
        low[c] = std::min(low[c], point[c]);
        high[c] = std::max(high[c], point[c]);
      }
    }
  }
  if (!(low[0] <= high[0])) return "";
  const double across = std::max(high[0] - low[0], 1e-6), up = std::max(high[1] - low[1], 1e-6);
  const double scale = std::min((kWidth - 2 * kMargin) / across, (kTallest - 2 * kMargin) / up);
  const double height = up * scale + 2 * kMargin;
  std::string out = std::string(kBegin) + "<p class=\"legend\">";
  for (std::size_t t = 0; t < tracks.size(); ++t) {
    out +=
        "<span><i style=\"background:" + color_of(t, tracks.size()) + "\"></i>" + escape(tracks[t].label) + "</span>";
  }
  out += "</p>\n<div class=\"card\"><svg viewBox=\"0 0 " + number(kWidth, 0) + " " + number(height + kBarRoom, 0) +
         "\" role=\"img\" aria-label=\"paths of the camera\">\n";
  for (std::size_t t = 0; t < tracks.size(); ++t) {
    // The path is interrupted where tracking was lost.
    std::string line;
    bool pen_down = false;
    for (const std::array<double, 2>& point : tracks[t].points) {
      if (!std::isfinite(point[0]) || !std::isfinite(point[1])) {
        pen_down = false;
        continue;
      }
      line += (pen_down ? "L" : "M") + number(kMargin + (point[0] - low[0]) * scale, 1) + " " +
              number(height - kMargin - (point[1] - low[1]) * scale, 1) + " ";
      pen_down = true;
    }
    out +=
        "<path fill=\"none\" stroke-width=\"2\" stroke=\"" + color_of(t, tracks.size()) + "\" d=\"" + line + "\"/>\n";
  }
  // Scale bar: the largest of 1, 2 and 5 times a power of ten that takes at most a quarter of the width.
  const double most = 0.25 * (kWidth - 2 * kMargin) / scale;
  const double power = std::pow(10.0, std::floor(std::log10(most)));
  const double bar = power * (most >= 5 * power ? 5 : most >= 2 * power ? 2 : 1);
  const int digits = static_cast<int>(std::max(0.0, -std::floor(std::log10(bar) + 1e-9)));
  const std::string level = number(height + 0.4 * kBarRoom, 0);
  out += "<path stroke=\"currentColor\" stroke-width=\"2\" d=\"M" + number(kMargin, 0) + " " + level + " L" +
         number(kMargin + bar * scale, 1) + " " + level + "\"/><text x=\"" + number(kMargin + bar * scale + 8, 0) +
         "\" y=\"" + number(height + 0.4 * kBarRoom + 4, 0) + "\">" +
         escape(number(bar, digits) + " " + tracks[0].unit) + "</text>\n" +
         "</svg></div>\n<p class=\"note\">Seen along the axis in which the camera moved least.</p>" + kEnd;
  return out;
}

std::string tracks_of_page(const std::filesystem::path& page) {
  std::ifstream in(page, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  const std::size_t begin = text.find(kBegin), end = text.find(kEnd, begin);
  if (begin == std::string::npos || end == std::string::npos) return "";
  return text.substr(begin, end + std::string_view(kEnd).size() - begin);
}

}  // namespace splatboost::report
